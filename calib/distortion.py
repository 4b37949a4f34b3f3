"""Lens distortion of normalised image coordinates (x / z, y / z), and its inverse.

The formulas are OpenCV's: `cv2.projectPoints` (Brown-Conrady with the rational terms, thin prisms
and a tilted sensor) and `cv2.fisheye` (Kannala-Brandt).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Float

RADTAN, FISHEYE = "radtan", "fisheye"

_MAX_STEPS = 12
_CONVERGED = 1e-9  # convergence is quadratic: the next step would be below rounding
_MIN_DETERMINANT = 0.05
_MAX_STEP = 0.3
_MAX_RADTAN = 5.0  # bounds of normalised coordinates
_MAX_FISHEYE = 1e6
_MAX_ANGLE_RAD = np.radians(89.0)
_TABLE_SIZE = 512
_MIN_SLOPE = 1e-3
_TINY = 1e-12
_NO_TERMS = (0.0,) * 14


class Lens(NamedTuple):
    """A distortion.

    Attributes:
        model: "radtan" or "fisheye".
        terms: Its coefficients in OpenCV's order, at least four.
    """

    model: str
    terms: tuple[float, ...]


def distort(lens: Lens, x: Float, y: Float) -> tuple[Float, Float]:
    """Apply the lens distortion to normalised coordinates.

    Args:
        lens: The distortion.
        x: x / z, any shape.
        y: y / z, the same shape.

    Returns:
        Distorted x and y of the same shape.
    """
    if lens.model == FISHEYE:
        radius = np.hypot(x, y)
        scale = _fisheye_radius(lens.terms, np.arctan(radius))
        scale /= np.maximum(radius, _TINY, out=radius)
        scale[radius <= _TINY] = 1.0
        return x * scale, y * scale
    _, _, p1, p2 = lens.terms[:4]
    s1, s2, s3, s4, *tilt_rad = _after_rational(lens.terms)
    squared = x * x + y * y
    radial = _radial(lens.terms, squared).value
    distorted_x = x * radial
    if p1 or p2:
        distorted_x += 2 * p1 * x * y
        distorted_x += p2 * (squared + 2 * x * x)
    distorted_y = np.multiply(y, radial, out=radial)
    if p1 or p2:
        distorted_y += p1 * (squared + 2 * y * y)
        distorted_y += 2 * p2 * x * y
    if s1 or s2 or s3 or s4:
        distorted_x += squared * (s1 + squared * s2)
        distorted_y += squared * (s3 + squared * s4)
    if any(tilt_rad):
        return _mapped(_tilt(*tilt_rad), distorted_x, distorted_y)
    return distorted_x, distorted_y


def undistort(lens: Lens, x: Float, y: Float) -> tuple[Float, Float]:
    """Remove the lens distortion from normalised coordinates; inverse of `distort`.

    Exact to rounding wherever the model is invertible. Far from the centre a model may not be:
    coordinates that no point is distorted to get a finite point near the limit. Points of a fisheye
    are at most 89 degrees off the axis.

    Args:
        lens: The distortion.
        x: Distorted x / z, any shape.
        y: Distorted y / z, the same shape.

    Returns:
        Undistorted x and y of the same shape.
    """
    if lens.model == FISHEYE:
        return _undistort_fisheye(lens.terms, x, y)
    tilt_rad = _after_rational(lens.terms)[4:]
    if any(tilt_rad):
        x, y = _mapped(np.linalg.inv(_tilt(*tilt_rad)), x, y)
    return _undistort_radtan(lens.terms, x, y)


def _after_rational(terms: tuple[float, ...]) -> tuple[float, ...]:
    """Return the terms of thin prisms s1 to s4 and the sensor's tilts tau x and tau y in rad."""
    return (*terms[8:], *_NO_TERMS)[:6]


def _tilt(about_x_rad: float, about_y_rad: float) -> Float:
    """Return the (3, 3) homography from a sensor across the optical axis to the tilted one."""
    (sx, sy), (cx, cy) = np.sin([about_x_rad, about_y_rad]), np.cos([about_x_rad, about_y_rad])
    turned = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ [
        [1, 0, 0],
        [0, cx, sx],
        [0, -sx, cx],
    ]
    along = turned[2, 2]
    return np.asarray([[along, 0, -turned[0, 2]], [0, along, -turned[1, 2]], [0, 0, 1]] @ turned)


def _mapped(homography: Float, x: Float, y: Float) -> tuple[Float, Float]:
    """Apply a homography; points behind the sensor keep a finite place far away."""
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in homography)
    w = np.maximum(w, _MIN_SLOPE)
    return u / w, v / w


class _Radial(NamedTuple):
    """The radial factor and its derivative with respect to the squared radius."""

    value: Float
    slope: Float


def _radial(terms: tuple[float, ...], squared: Float, with_slope: bool = False) -> _Radial:
    """Evaluate Brown's polynomial of the squared radius over the rational terms' polynomial."""
    k1, k2, _, _, k3, k4, k5, k6 = (*terms, *_NO_TERMS)[:8]
    value = 1 + squared * (k1 + squared * (k2 + squared * k3))
    slope = k1 + squared * (2 * k2 + squared * (3 * k3)) if with_slope else value
    if k4 or k5 or k6:
        denominator = 1 + squared * (k4 + squared * (k5 + squared * k6))
        value /= denominator
        if with_slope:
            slope -= value * (k4 + squared * (2 * k5 + squared * (3 * k6)))
            slope /= denominator
    return _Radial(value, slope)


def _undistort_radtan(terms: tuple[float, ...], x: Float, y: Float) -> tuple[Float, Float]:
    """Invert by Newton's method with bounded steps; the sensor's tilt is removed already."""
    p1, p2 = terms[2:4]
    s1, s2, s3, s4 = _after_rational(terms)[:4]
    has_prism = bool(s1 or s2 or s3 or s4)
    u, v = np.clip(x, -_MAX_RADTAN, _MAX_RADTAN), np.clip(y, -_MAX_RADTAN, _MAX_RADTAN)
    for _ in range(_MAX_STEPS):
        squared = u * u + v * v
        radial, slope = _radial(terms, squared, with_slope=True)
        slope = 2 * slope
        residual_x = x - (u * radial + 2 * p1 * u * v + p2 * (squared + 2 * u * u))
        residual_y = y - (v * radial + p1 * (squared + 2 * v * v) + 2 * p2 * u * v)
        du_dx = radial + slope * u * u + 2 * p1 * v + 6 * p2 * u
        dv_dy = radial + slope * v * v + 6 * p1 * v + 2 * p2 * u
        dv_dx = du_dy = slope * u * v + 2 * p1 * u + 2 * p2 * v
        if has_prism:
            residual_x -= squared * (s1 + squared * s2)
            residual_y -= squared * (s3 + squared * s4)
            by_x, by_y = 2 * (s1 + 2 * s2 * squared), 2 * (s3 + 2 * s4 * squared)
            du_dx, dv_dy = du_dx + by_x * u, dv_dy + by_y * v
            du_dy, dv_dx = du_dy + by_x * v, dv_dx + by_y * u
        determinant = np.maximum(du_dx * dv_dy - du_dy * dv_dx, _MIN_DETERMINANT)
        step_u = (dv_dy * residual_x - du_dy * residual_y) / determinant
        step_v = (du_dx * residual_y - dv_dx * residual_x) / determinant
        u = np.clip(u + np.clip(step_u, -_MAX_STEP, _MAX_STEP), -_MAX_RADTAN, _MAX_RADTAN)
        v = np.clip(v + np.clip(step_v, -_MAX_STEP, _MAX_STEP), -_MAX_RADTAN, _MAX_RADTAN)
        if max(np.abs(step_u).max(initial=0), np.abs(step_v).max(initial=0)) < _CONVERGED:
            break
    return u, v


def _fisheye_radius(terms: tuple[float, ...], angle: Float) -> Float:
    """Return the distorted radius of a point `angle` rad off the axis."""
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
    """Return the derivative of `_fisheye_radius` with respect to the angle."""
    k1, k2, k3, k4 = terms
    squared = angle * angle
    return 1 + squared * (3 * k1 + squared * (5 * k2 + squared * (7 * k3 + squared * 9 * k4)))


def _undistort_fisheye(terms: tuple[float, ...], x: Float, y: Float) -> tuple[Float, Float]:
    """Start from a table of the model's increasing part, then use Newton's method."""
    angles = np.linspace(0, _MAX_ANGLE_RAD, _TABLE_SIZE)
    falling = np.flatnonzero(_fisheye_slope(terms, angles) < _MIN_SLOPE)
    angles = angles[: falling[0] if len(falling) else None]
    radii = _fisheye_radius(terms, angles)
    x, y = np.clip(x, -_MAX_FISHEYE, _MAX_FISHEYE), np.clip(y, -_MAX_FISHEYE, _MAX_FISHEYE)
    radius = np.hypot(x, y)
    reached = np.minimum(radius, radii[-1])
    angle = np.interp(reached, radii, angles)
    for _ in range(_MAX_STEPS):
        step = (reached - _fisheye_radius(terms, angle)) / np.maximum(
            _fisheye_slope(terms, angle), _MIN_SLOPE
        )
        angle = np.clip(angle + step, 0, angles[-1])
        if np.abs(step).max(initial=0) < _CONVERGED:
            break
    scale = np.tan(angle) / np.maximum(radius, _TINY)
    scale = np.where(radius > _TINY, scale, 1.0)
    return x * scale, y * scale
