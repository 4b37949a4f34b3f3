"""The axis of a stem in the picture: the plane through the camera that holds it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.section import AxisFrame, axis_frame

__all__ = ["fit_axis"]

Float = NDArray[np.floating[Any]]


def fit_axis(
    rays: Float, std_rad: Float, up: Float, lean_std_rad: float
) -> tuple[AxisFrame, float]:
    """The plane through the camera nearest to the rays on the axis and to the vertical.

    Args:
        rays: (N, 3) rays to points of the axis, at least one.
        std_rad: (N,) standard deviations of their angles.
        up: (3,) unit vector of the vertical, which a stem follows within `lean_std_rad`: where
            the rays lie too close together to tell the direction, it does.

    Returns:
        The frame whose axis is, in that plane, nearest to the vertical; and the standard
        deviation in radians of the axis' angle as seen, within the picture.
    """
    directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    directions = np.concatenate([directions, up[None]])
    weight = 1 / np.append(std_rad, lean_std_rad) ** 2
    scatter = (directions.T * weight) @ directions
    normal = np.linalg.eigh(scatter)[1][:, 0]
    frame = axis_frame(normal, up)
    turned = np.stack([frame.along, frame.away])
    covariance = np.linalg.inv(turned @ scatter @ turned.T)
    return frame, float(np.sqrt(covariance[0, 0]))
