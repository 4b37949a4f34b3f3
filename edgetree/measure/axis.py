"""Fit the directions of stem axes to points in the image and to the vertical."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.section import StemAxes, axes_in_planes, lengths

__all__ = ["fit_axes"]

Float = NDArray[np.floating[Any]]


def fit_axes(rays: Float, std_rad: Float, up: Float, lean_std_rad: float) -> tuple[StemAxes, Float]:
    """Fit the plane through the camera that holds each stem's axis.

    A weighted total least squares fit: the plane's normal is the eigenvector with the smallest
    eigenvalue of the rays' weighted scatter matrix. The vertical counts as one more ray, with
    standard deviation `lean_std_rad`. It decides where the rays are too close together to tell
    the direction.

    Args:
        rays: (T, N, 3) rays to points on the axes; NaN where there is none.
        std_rad: (T, N) standard deviations of their angles; infinite for rays to ignore.
        up: (3,) unit vector of the vertical.
        lean_std_rad: standard deviation of a stem's angle from the vertical.

    Returns:
        The axes in those planes that are closest to the vertical, and (T,) the standard deviation
        of each axis' angle in the image, in radians, from the inverse of the information matrix.
    """
    known = np.isfinite(rays).all(axis=2) & ~np.isnan(std_rad)
    rays = np.where(known[..., None], rays, up)
    directions = rays / lengths(rays)[..., None]
    weight = np.where(known, 1 / std_rad**2, 0.0)
    scatter = np.matmul((directions * weight[..., None]).transpose(0, 2, 1), directions)
    scatter = scatter + np.outer(up, up) / lean_std_rad**2
    normals = np.linalg.eigh(scatter)[1][:, :, 0]
    axes = axes_in_planes(normals, up)
    in_plane = np.stack([axes.along, axes.away], 1)
    information = np.matmul(np.matmul(in_plane, scatter), in_plane.transpose(0, 2, 1))
    determinant = information[:, 0, 0] * information[:, 1, 1] - information[:, 0, 1] ** 2
    return axes, np.sqrt(information[:, 1, 1] / np.maximum(determinant, 1e-12))
