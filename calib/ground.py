"""The ground as a plane, fitted robustly to camera points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import CalibError

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

CAMERA_UP = (0.0, -1.0, 0.0)
_LEAST_POINTS = 12
_TRIALS = 40
_LEAST_INLIERS = 0.3
_REFINEMENTS = 2
_NARROWEST = 0.01
# Plants stand on the ground and nothing lies below it: a point below a plane counts against it.
_BELOW = 0.7


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """Points p with ``normal`` . p + ``offset_m`` = 0 in the camera frame.

    ``normal`` (3,) is a unit vector pointing up; ``residual_std_m`` the spread of the inliers
    about the plane; ``inlier_fraction`` their share of the points given; ``points`` their number,
    of which ``independent_points`` err independently. The inliers lie around ``centre_m`` (3,),
    spread by ``extents_m`` (2,) along the plane's directions ``axes`` (2, 3).
    """

    normal: Float
    offset_m: float
    residual_std_m: float
    inlier_fraction: float
    points: int
    independent_points: float
    centre_m: Float
    axes: Float
    extents_m: Float

    def height_m(self, points_m: ArrayLike) -> Float:
        """(...) metres above the plane, across it, of (..., 3) camera points."""
        return np.asarray(np.asarray(points_m, np.float64) @ self.normal + self.offset_m)

    def height_std_m(self, points_m: ArrayLike) -> Float:
        """(...) standard deviation of the plane's own height under (..., 3) camera points.

        That of a regression plane: residual * sqrt((1 + (u / su)² + (v / sv)²) / n), with the
        place u, v along the axes and the points' extents there.
        """
        place = (np.asarray(points_m, np.float64) - self.centre_m) @ self.axes.T
        leverage = 1 + ((place / self.extents_m) ** 2).sum(-1)
        return np.asarray(self.residual_std_m * np.sqrt(leverage / self.independent_points))

    @property
    def tilt_std_deg(self) -> float:
        """Standard deviation of the normal's direction, in the worse of its two."""
        least = float(self.extents_m.min())
        return float(np.degrees(self.residual_std_m / (least * np.sqrt(self.independent_points))))


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

    ``up`` (3,) is the direction away from gravity in the camera frame, from an IMU or the
    mounting (default: the camera's own up); planes steeper than ``max_slope_deg`` against it are
    not ground. ``tolerance_m`` is how far a point may lie from the plane to support it.
    Deterministic. Returns a falsy GroundPlaneFailure where there are too few points or no plane
    holds 30 % of them. Raises CalibError where ``up`` is no direction.
    """
    points = np.asarray(points_m, np.float64).reshape(1, -1, 3)
    usable = np.asarray(np.isfinite(points).all(axis=2))
    return fit_ground_planes(points, usable, up, max_slope_deg, tolerance_m)[0]


def fit_ground_planes(
    points_m: Float,
    usable: Flags,
    up: ArrayLike | None = None,
    max_slope_deg: float = 45.0,
    tolerance_m: float = 0.06,
    points_per_error: float = 1.0,
) -> list[GroundPlane | GroundPlaneFailure]:
    """``fit_ground_plane`` for (T, N, 3) points of T places at once, of which (T, N) are usable.

    ``points_per_error`` is how many neighbours share one error of the sensor.
    """
    vertical = _direction(CAMERA_UP if up is None else up)
    if not points_m.shape[1]:
        few = f"0 ground points, expected at least {_LEAST_POINTS}"
        return [GroundPlaneFailure(few)] * len(points_m)
    least_cosine = float(np.cos(np.radians(max_slope_deg)))
    points = np.where(usable[..., None], points_m, 0.0)
    count = usable.sum(1)
    support, flat = _best_support(points, usable, vertical, least_cosine, tolerance_m)
    for _ in range(_REFINEMENTS):
        centre, squares, axes = _spread(points, support)
        normal = axes[:, :, 0] * np.where(axes[:, :, 0] @ vertical < 0, -1.0, 1.0)[:, None]
        offset = -(normal * centre).sum(1)
        away = np.matmul(points, normal[..., None])[..., 0] + offset[:, None]
        support = usable & (np.abs(away) < tolerance_m)
    fits = _Fits(count, flat, squares, axes, centre, normal, offset, support)
    return [
        fits.plane(place, points[place], points_per_error, max_slope_deg, vertical)
        for place in range(len(points))
    ]


class _Fits(NamedTuple):
    """Planes of T places: (T,) number of ``usable`` points and whether any trial was ``flat``; mean
    ``squares`` (T, 3) along ``axes`` (T, 3, 3) about ``centre`` (T, 3) of the ``support`` (T, N).
    """

    usable: NDArray[np.intp]
    flat: Flags
    squares: Float
    axes: Float
    centre: Float
    normal: Float
    offset: Float
    support: Flags

    def plane(
        self, at: int, points: Float, points_per_error: float, max_slope_deg: float, vertical: Float
    ) -> GroundPlane | GroundPlaneFailure:
        """One of them, or why there is none."""
        support, normal, squares = self.support[at], self.normal[at], self.squares[at]
        held = int(support.sum())
        share = held / max(int(self.usable[at]), 1)
        if self.usable[at] < _LEAST_POINTS:
            few = f"{self.usable[at]} ground points, expected at least {_LEAST_POINTS}"
            return GroundPlaneFailure(few)
        if not self.flat[at]:
            return GroundPlaneFailure(f"no plane flatter than {max_slope_deg:g} degrees")
        if squares[1] < _NARROWEST**2 * squares[2]:
            return GroundPlaneFailure("the ground points lie on one line")
        if share < _LEAST_INLIERS:
            return GroundPlaneFailure(
                f"the best plane holds {share:.0%} of the points, expected {_LEAST_INLIERS:.0%}"
            )
        if normal @ vertical < np.cos(np.radians(max_slope_deg)):
            return GroundPlaneFailure(f"no plane flatter than {max_slope_deg:g} degrees")
        offset_m = float(self.offset[at])
        residual = float(np.sqrt(np.mean((points[support] @ normal + offset_m) ** 2)))
        independent = max(held / points_per_error, 1.0)
        return GroundPlane(
            normal,
            offset_m,
            residual,
            share,
            held,
            independent,
            self.centre[at],
            self.axes[at, :, 1:].T,
            np.sqrt(squares[1:]),
        )


def _direction(up: ArrayLike) -> Float:
    """``up`` at unit length."""
    vertical = np.asarray(up, np.float64)
    length = float(np.linalg.norm(vertical)) if vertical.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0):
        raise CalibError(f"up is {vertical.tolist()}: expected a direction of three numbers")
    return vertical / length


def _spread(points: Float, support: Flags) -> tuple[Float, Float, Float]:
    """Centres (T, 3) of the supporting points, their mean squares (T, 3) along the axes, from
    least to most, and the axes (T, 3, 3) in columns.
    """
    weight = support / np.maximum(support.sum(1, keepdims=True), 1)
    centre = np.matmul(weight[:, None], points)[:, 0]
    offset = np.where(support[..., None], points - centre[:, None], 0.0)
    scatter = np.matmul((offset * weight[..., None]).transpose(0, 2, 1), offset)
    squares, axes = np.linalg.eigh(scatter)
    return centre, np.maximum(squares, 1e-18), axes


def _best_support(
    points: Float, usable: Flags, vertical: Float, least_cosine: float, tolerance_m: float
) -> tuple[Flags, Flags]:
    """(T, N) which points lie near the best of many planes through three of them, and (T,)
    whether any of these planes was flat enough.
    """
    order = np.argsort(~usable, axis=1, kind="stable")
    count = np.maximum(usable.sum(1), 1)
    draw = np.random.default_rng(0).random((1, 3 * _TRIALS))
    picked = np.take_along_axis(order, (draw * count[:, None]).astype(np.intp), 1)
    a, b, c = np.split(np.take_along_axis(points, picked[..., None], 1), 3, axis=1)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = normals / np.where(length > 1e-9, length, np.inf)
    cosine = normals @ vertical
    normals = normals * np.where(cosine < 0, -1.0, 1.0)[..., None]
    flat = np.abs(cosine) >= least_cosine
    through = (normals * a).sum(2)
    height = np.matmul(normals, points.transpose(0, 2, 1)) - through[..., None]
    within = usable[:, None] & flat[..., None]
    near = (np.abs(height) < tolerance_m) & within
    below = (height <= -tolerance_m) & within
    best = (near.sum(2) - _BELOW * below.sum(2)).argmax(1)
    return np.asarray(near[np.arange(len(points)), best]), np.asarray(flat.any(axis=1))
