"""Geometry of the level plane: angles, turns, and distances in units of their errors."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from basetree.arrays import Float

_Angle = TypeVar("_Angle", float, Float)


def wrapped(angle_rad: _Angle) -> _Angle:
    """The same angles from -pi on to below pi."""
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


def turns(angle_rad: Float) -> Float:
    """(..., 2, 2) rotations by (...) angles."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)


def place_jacobian(turned_m: Float) -> Float:
    """(K, 2, 3) change of the map places of points with the camera's place and heading.

    Args:
        turned_m: (K, 2) the points from the camera, in the directions of the map.
    """
    jacobian = np.zeros((len(turned_m), 2, 3))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0
    jacobian[:, 0, 2], jacobian[:, 1, 2] = -turned_m[:, 1], turned_m[:, 0]
    return jacobian


def chi_squares(offset: Float, covariance: Float) -> Float:
    """(...) chi-squares of (..., 2) offsets with (..., 2, 2) covariances."""
    a, b, d = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    x, y = offset[..., 0], offset[..., 1]
    return np.asarray((d * x**2 - 2 * b * x * y + a * y**2) / determinants(covariance))


def determinants(matrices: Float) -> Float:
    """(...) determinants of (..., 2, 2) matrices."""
    return np.asarray(
        matrices[..., 0, 0] * matrices[..., 1, 1] - matrices[..., 0, 1] * matrices[..., 1, 0]
    )
