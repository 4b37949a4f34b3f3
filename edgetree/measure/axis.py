"""The axes of stems in the picture: the planes through the camera that hold them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.section import AxisFrames, axis_frames

__all__ = ["fit_axes"]

Float = NDArray[np.floating[Any]]


def fit_axes(
    rays: Float, std_rad: Float, up: Float, lean_std_rad: float
) -> tuple[AxisFrames, Float]:
    """The planes through the camera nearest to the rays on each axis and to the vertical.

    Args:
        rays: (T, N, 3) rays to points of the axes.
        std_rad: (T, N) standard deviations of their angles; infinite for rays that say nothing.
        up: (3,) unit vector of the vertical, which a stem follows within `lean_std_rad`: where
            the rays lie too close together to tell the direction, it does.

    Returns:
        The frames whose axes are, in those planes, nearest to the vertical; and (T,) the standard
        deviation in radians of each axis' angle as seen, within the picture.
    """
    known = np.isfinite(rays).all(axis=2) & ~np.isnan(std_rad)
    rays = np.where(known[..., None], rays, up)
    directions = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    weight = np.where(known, 1 / std_rad**2, 0.0)
    scatter = np.matmul((directions * weight[..., None]).transpose(0, 2, 1), directions)
    scatter = scatter + np.outer(up, up) / lean_std_rad**2
    normals = np.linalg.eigh(scatter)[1][:, :, 0]
    frames = axis_frames(normals, up)
    turned = np.stack([frames.along, frames.away], 1)
    information = np.matmul(np.matmul(turned, scatter), turned.transpose(0, 2, 1))
    determinant = information[:, 0, 0] * information[:, 1, 1] - information[:, 0, 1] ** 2
    return frames, np.sqrt(information[:, 1, 1] / np.maximum(determinant, 1e-12))
