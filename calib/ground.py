"""The ground as a plane, fitted robustly to camera points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import CalibError

Float = NDArray[np.floating[Any]]

CAMERA_UP = (0.0, -1.0, 0.0)
_LEAST_POINTS = 12
_TRIALS = 120
_LEAST_INLIERS = 0.3
_REFINEMENTS = 3
_NARROWEST = 0.01


@dataclass(frozen=True)
class GroundPlane:
    """Points p with ``normal`` . p + ``offset_m`` = 0 in the camera frame.

    ``normal`` (3,) is a unit vector pointing up; ``residual_std_m`` the spread of the inliers
    about the plane; ``inlier_fraction`` their share of the points given; ``points`` their number.
    """

    normal: Float
    offset_m: float
    residual_std_m: float
    inlier_fraction: float
    points: int

    def height_m(self, points_m: ArrayLike) -> Float:
        """(...) metres above the plane, across it, of (..., 3) camera points."""
        return np.asarray(np.asarray(points_m, np.float64) @ self.normal + self.offset_m)


@dataclass(frozen=True)
class GroundPlaneFailure:
    """No plane, and why. Falsy."""

    reason: str

    def __bool__(self) -> bool:
        return False


def fit_ground_plane(
    points_m: ArrayLike,
    up: ArrayLike | None = None,
    max_slope_deg: float = 45.0,
    tolerance_m: float = 0.06,
) -> GroundPlane | GroundPlaneFailure:
    """Fit a plane to (N, 3) camera points: random samples of three, then least squares.

    ``up`` (3,) is the direction away from gravity in the camera frame (default: the camera's own
    up); planes steeper than ``max_slope_deg`` against it are not ground. ``tolerance_m`` is how
    far a point may lie from the plane to support it. Deterministic. Returns a falsy
    GroundPlaneFailure where there are too few points or no plane holds a third of them. Raises
    CalibError where ``up`` is no direction.
    """
    points = np.asarray(points_m, np.float64).reshape(-1, 3)
    points = points[np.isfinite(points).all(1)]
    if len(points) < _LEAST_POINTS:
        return GroundPlaneFailure(f"{len(points)} ground points, expected at least {_LEAST_POINTS}")
    vertical = _direction(CAMERA_UP if up is None else up)
    least_cosine = float(np.cos(np.radians(max_slope_deg)))
    support = _best_support(points, vertical, least_cosine, tolerance_m)
    if support is None:
        return GroundPlaneFailure(f"no plane flatter than {max_slope_deg:g} degrees")
    normal, offset = np.zeros(3), 0.0
    for _ in range(_REFINEMENTS):
        centre = points[support].mean(0)
        offsets = points[support] - centre
        squared_spreads, directions = np.linalg.eigh(offsets.T @ offsets)
        if squared_spreads[1] < _NARROWEST**2 * squared_spreads[2]:
            return GroundPlaneFailure("the ground points lie on one line")
        normal = directions[:, 0] * np.sign(directions[:, 0] @ vertical or 1.0)
        offset = float(-normal @ centre)
        support = np.abs(points @ normal + offset) < tolerance_m
        fraction = float(support.mean())
        if fraction < _LEAST_INLIERS:
            return GroundPlaneFailure(
                f"the best plane holds {fraction:.0%} of the points, expected {_LEAST_INLIERS:.0%}"
            )
    if normal @ vertical < least_cosine:
        return GroundPlaneFailure(f"no plane flatter than {max_slope_deg:g} degrees")
    spread = float(np.std(points[support] @ normal + offset))
    return GroundPlane(normal, offset, spread, float(support.mean()), int(support.sum()))


def _direction(up: ArrayLike) -> Float:
    """``up`` at unit length."""
    vertical = np.asarray(up, np.float64)
    length = float(np.linalg.norm(vertical)) if vertical.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0):
        raise CalibError(f"up is {vertical.tolist()}: expected a direction of three numbers")
    return vertical / length


def _best_support(
    points: Float, vertical: Float, least_cosine: float, tolerance_m: float
) -> NDArray[np.bool_] | None:
    """Which points lie near the best of many planes through three of them; None without any."""
    rng = np.random.default_rng(0)
    a, b, c = points[rng.integers(len(points), size=(3, _TRIALS))]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    usable = length > 1e-9
    normals = normals[usable] / length[usable, None]
    flat = np.abs(normals @ vertical) >= least_cosine
    if not flat.any():
        return None
    normals, through = normals[flat], a[usable][flat]
    distance = np.abs(points @ normals.T - (through * normals).sum(1))
    near = distance < tolerance_m
    return np.asarray(near[:, np.argmax(near.sum(0))])
