"""Lens distortion of normalised image coordinates (x / z, y / z), and its inverse.

The formulas are those of OpenCV's ``projectPoints`` (Brown, with the rational terms) and of its
fisheye module (Kannala and Brandt).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.camera import FISHEYE, PinholeCamera

Float = NDArray[np.floating[Any]]

_STEPS = 12
_ENOUGH = 1e-9  # the step after it is below rounding: convergence is quadratic
_LEAST_DETERMINANT = 0.05
_LONGEST_STEP = 0.3
_WIDEST = 5.0
_FARTHEST = 1e6
_WIDEST_ANGLE_RAD = np.radians(89.0)
_TABLE = 512
_LEAST_SLOPE = 1e-3
_TINY = 1e-12


def distort(camera: PinholeCamera, x: Float, y: Float) -> tuple[Float, Float]:
    """Where the lens moves the normalised coordinates ``x``, ``y`` of any one shape."""
    if camera.distortion_model == FISHEYE:
        radius = np.hypot(x, y)
        scale = _fisheye_radius(camera.distortion, np.arctan(radius))
        scale /= np.maximum(radius, _TINY, out=radius)
        scale[radius <= _TINY] = 1.0
        return x * scale, y * scale
    _, _, p1, p2 = camera.distortion[:4]
    squared = x * x + y * y
    radial = _radial(camera.distortion, squared).value
    moved_x = x * radial
    if p1 or p2:
        moved_x += 2 * p1 * x * y
        moved_x += p2 * (squared + 2 * x * x)
    moved_y = np.multiply(y, radial, out=radial)
    if p1 or p2:
        moved_y += p1 * (squared + 2 * y * y)
        moved_y += 2 * p2 * x * y
    return moved_x, moved_y


def undistort(camera: PinholeCamera, x: Float, y: Float) -> tuple[Float, Float]:
    """The inverse of ``distort``, to rounding, wherever the model has one.

    Far from the centre a model may fold back, so that no point reaches a coordinate: it gets a
    finite point near the fold. A fisheye's point is at most 89 degrees off the axis.
    """
    if camera.distortion_model == FISHEYE:
        return _undistort_fisheye(camera.distortion, x, y)
    return _undistort_radtan(camera.distortion, x, y)


class _Radial(NamedTuple):
    """The radial factor and its derivative by the squared radius."""

    value: Float
    slope: Float


def _radial(terms: tuple[float, ...], squared: Float, with_slope: bool = False) -> _Radial:
    """Brown's polynomial of the squared radius, over that of the rational terms."""
    k1, k2, _, _, k3, k4, k5, k6 = (*terms, 0.0, 0.0, 0.0, 0.0)[:8]
    value = 1 + squared * (k1 + squared * (k2 + squared * k3))
    slope = k1 + squared * (2 * k2 + squared * (3 * k3)) if with_slope else value
    if k4 or k5 or k6:
        below = 1 + squared * (k4 + squared * (k5 + squared * k6))
        value /= below
        if with_slope:
            slope -= value * (k4 + squared * (2 * k5 + squared * (3 * k6)))
            slope /= below
    return _Radial(value, slope)


def _undistort_radtan(terms: tuple[float, ...], x: Float, y: Float) -> tuple[Float, Float]:
    """By Newton's method with bounded steps."""
    p1, p2 = terms[2:4]
    u, v = np.clip(x, -_WIDEST, _WIDEST), np.clip(y, -_WIDEST, _WIDEST)
    for _ in range(_STEPS):
        squared = u * u + v * v
        radial, slope = _radial(terms, squared, with_slope=True)
        slope = 2 * slope
        miss_x = x - (u * radial + 2 * p1 * u * v + p2 * (squared + 2 * u * u))
        miss_y = y - (v * radial + p1 * (squared + 2 * v * v) + 2 * p2 * u * v)
        du_dx = radial + slope * u * u + 2 * p1 * v + 6 * p2 * u
        dv_dy = radial + slope * v * v + 6 * p1 * v + 2 * p2 * u
        mixed = slope * u * v + 2 * p1 * u + 2 * p2 * v
        determinant = np.maximum(du_dx * dv_dy - mixed * mixed, _LEAST_DETERMINANT)
        step_u = (dv_dy * miss_x - mixed * miss_y) / determinant
        step_v = (du_dx * miss_y - mixed * miss_x) / determinant
        u = np.clip(u + np.clip(step_u, -_LONGEST_STEP, _LONGEST_STEP), -_WIDEST, _WIDEST)
        v = np.clip(v + np.clip(step_v, -_LONGEST_STEP, _LONGEST_STEP), -_WIDEST, _WIDEST)
        if max(np.abs(step_u).max(initial=0), np.abs(step_v).max(initial=0)) < _ENOUGH:
            break
    return u, v


def _fisheye_radius(terms: tuple[float, ...], angle: Float) -> Float:
    """The distorted radius of a point ``angle`` rad off the axis."""
    k1, k2, k3, k4 = terms
    squared = angle * angle
    radius = squared * k4
    for term in (k3, k2, k1):
        radius += term
        radius *= squared
    radius += 1
    radius *= angle
    return radius


def _fisheye_slope(terms: tuple[float, ...], angle: Float) -> Float:
    """The derivative of ``_fisheye_radius`` by the angle."""
    k1, k2, k3, k4 = terms
    squared = angle * angle
    return 1 + squared * (3 * k1 + squared * (5 * k2 + squared * (7 * k3 + squared * 9 * k4)))


def _undistort_fisheye(terms: tuple[float, ...], x: Float, y: Float) -> tuple[Float, Float]:
    """The angle from a table of the rising part of the model, then Newton's method."""
    angles = np.linspace(0, _WIDEST_ANGLE_RAD, _TABLE)
    falling = np.flatnonzero(_fisheye_slope(terms, angles) < _LEAST_SLOPE)
    angles = angles[: falling[0] if len(falling) else None]
    radii = _fisheye_radius(terms, angles)
    x, y = np.clip(x, -_FARTHEST, _FARTHEST), np.clip(y, -_FARTHEST, _FARTHEST)
    radius = np.hypot(x, y)
    reached = np.minimum(radius, radii[-1])
    angle = np.interp(reached, radii, angles)
    for _ in range(_STEPS):
        step = (reached - _fisheye_radius(terms, angle)) / np.maximum(
            _fisheye_slope(terms, angle), _LEAST_SLOPE
        )
        angle = np.clip(angle + step, 0, angles[-1])
        if np.abs(step).max(initial=0) < _ENOUGH:
            break
    scale = np.tan(angle) / np.maximum(radius, _TINY)
    scale = np.where(radius > _TINY, scale, 1.0)
    return x * scale, y * scale
