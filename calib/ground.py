"""Robust fit of the ground plane to camera points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import CalibError

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

CAMERA_UP = (0.0, -1.0, 0.0)
_MIN_POINTS = 12
_TRIALS = 40
_MIN_INLIER_SHARE = 0.3
_REFINEMENTS = 2
_MIN_WIDTH_RATIO = 0.01  # of the points' spread across to the spread along
# Plants stand above the ground and nothing lies below it: points below a plane reduce its score.
_PENALTY_BELOW = 0.7


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """Plane of the points p with ``normal`` . p + ``offset_m`` = 0, in camera coordinates.

    Attributes:
        normal: (3,) unit vector pointing up.
        offset_m: Height of the camera above the plane, in metres.
        residual_std_m: Root mean square distance of the inliers from the plane.
        inlier_fraction: Share of the usable points that are inliers.
        points: Number of inliers.
        independent_points: Number of inliers with independent errors.
        centre_m: (3,) mean of the inliers.
        axes: (2, 3) unit vectors in the plane: the principal axes of the inliers.
        extents_m: (2,) standard deviations of the inliers along ``axes``.
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
        """Return the (...) metres above the plane, along its normal, of (..., 3) camera points."""
        return np.asarray(np.asarray(points_m, np.float64) @ self.normal + self.offset_m)

    def height_std_m(self, points_m: ArrayLike) -> Float:
        """Return the (...) standard deviation of the plane's height at (..., 3) camera points.

        The prediction error of a regression plane: residual * sqrt((1 + (u / su)² + (v / sv)²) /
        n), where u, v are the point's coordinates along the axes and su, sv the extents.
        """
        offset_m = (np.asarray(points_m, np.float64) - self.centre_m) @ self.axes.T
        leverage = 1 + ((offset_m / self.extents_m) ** 2).sum(-1)
        return np.asarray(self.residual_std_m * np.sqrt(leverage / self.independent_points))

    @property
    def tilt_std_deg(self) -> float:
        """Standard deviation of the normal's direction along its less certain axis."""
        least = float(self.extents_m.min())
        return float(np.degrees(self.residual_std_m / (least * np.sqrt(self.independent_points))))


@dataclass(frozen=True)
class GroundPlaneFailure:
    """The reason why no ground plane was found. Falsy."""

    reason: str

    def __bool__(self) -> bool:
        return False


def fit_ground_plane(
    points_m: ArrayLike,
    up: ArrayLike | None = None,
    max_slope_deg: float = 45.0,
    tolerance_m: float = 0.06,
) -> GroundPlane | GroundPlaneFailure:
    """Fit a plane by RANSAC (random samples of three points), then least squares.

    The result is deterministic.

    Args:
        points_m: (N, 3) camera points in metres; rows that are not finite are ignored.
        up: (3,) direction away from gravity in camera coordinates, from an IMU or the mounting. The
            default is the camera's own up, (0, -1, 0).
        max_slope_deg: Largest angle between the plane's normal and ``up``.
        tolerance_m: Largest distance of an inlier from the plane.

    Returns:
        The plane, or a falsy GroundPlaneFailure if there are fewer than 12 points, if they lie on a
        line, if every plane is too steep, or if less than 30 % of the points are inliers.

    Raises:
        CalibError: If ``up`` is not a direction.
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
    """Fit a plane to each of T sets of points at once; see ``fit_ground_plane``.

    Args:
        points_m: (T, N, 3) camera points in metres.
        usable: (T, N) bool, the points to use.
        up: (3,) direction away from gravity in camera coordinates.
        max_slope_deg: Largest angle between a plane's normal and ``up``.
        tolerance_m: Largest distance of an inlier from its plane.
        points_per_error: Number of neighbouring points that share one error of the sensor; it
            lowers ``independent_points``.

    Returns:
        A plane or a GroundPlaneFailure for each set.

    Raises:
        CalibError: If ``up`` is not a direction.
    """
    vertical = _direction(CAMERA_UP if up is None else up)
    if not points_m.shape[1]:
        few = f"0 ground points, expected at least {_MIN_POINTS}"
        return [GroundPlaneFailure(few)] * len(points_m)
    least_cosine = float(np.cos(np.radians(max_slope_deg)))
    points = np.where(usable[..., None], points_m, 0.0)
    count = usable.sum(1)
    support, flat = _best_support(points, usable, vertical, least_cosine, tolerance_m)
    for _ in range(_REFINEMENTS):
        centre, variances, axes = _principal_axes(points, support)
        normal = axes[:, :, 0] * np.where(axes[:, :, 0] @ vertical < 0, -1.0, 1.0)[:, None]
        offset = -(normal * centre).sum(1)
        distances = np.matmul(points, normal[..., None])[..., 0] + offset[:, None]
        support = usable & (np.abs(distances) < tolerance_m)
    fits = _Fits(count, flat, variances, axes, centre, normal, offset, support)
    return [
        fits.plane(index, points[index], points_per_error, max_slope_deg, vertical)
        for index in range(len(points))
    ]


class _Fits(NamedTuple):
    """Planes fitted to T sets of points.

    Attributes:
        usable: (T,) number of usable points.
        flat: (T,) whether any trial plane was flat enough.
        variances: (T, 3) variances along ``axes``, ascending.
        axes: (T, 3, 3) principal axes in columns.
        centre: (T, 3) means of the inliers.
        normal: (T, 3) unit normals pointing up.
        offset: (T,) plane offsets in metres.
        support: (T, N) inliers.
    """

    usable: NDArray[np.intp]
    flat: Flags
    variances: Float
    axes: Float
    centre: Float
    normal: Float
    offset: Float
    support: Flags

    def plane(
        self, at: int, points: Float, points_per_error: float, max_slope_deg: float, vertical: Float
    ) -> GroundPlane | GroundPlaneFailure:
        """Return the plane of set ``at``, or the reason why there is none."""
        support, normal, variances = self.support[at], self.normal[at], self.variances[at]
        held = int(support.sum())
        share = held / max(int(self.usable[at]), 1)
        if self.usable[at] < _MIN_POINTS:
            few = f"{self.usable[at]} ground points, expected at least {_MIN_POINTS}"
            return GroundPlaneFailure(few)
        if not self.flat[at]:
            return GroundPlaneFailure(f"no plane flatter than {max_slope_deg:g} degrees")
        if variances[1] < _MIN_WIDTH_RATIO**2 * variances[2]:
            return GroundPlaneFailure("the ground points lie on one line")
        if share < _MIN_INLIER_SHARE:
            return GroundPlaneFailure(
                f"the best plane holds {share:.0%} of the points, expected {_MIN_INLIER_SHARE:.0%}"
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
            np.sqrt(variances[1:]),
        )


def _direction(up: ArrayLike) -> Float:
    """Return ``up`` normalised to unit length."""
    vertical = np.asarray(up, np.float64)
    length = float(np.linalg.norm(vertical)) if vertical.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0):
        raise CalibError(f"up is {vertical.tolist()}: expected a direction of three numbers")
    return vertical / length


def _principal_axes(points: Float, support: Flags) -> tuple[Float, Float, Float]:
    """Return the principal axes of the supporting points of each set.

    Returns:
        Means (T, 3), variances along the axes (T, 3) in ascending order, and axes (T, 3, 3) in
        columns.
    """
    weight = support / np.maximum(support.sum(1, keepdims=True), 1)
    centre = np.matmul(weight[:, None], points)[:, 0]
    offset = np.where(support[..., None], points - centre[:, None], 0.0)
    scatter = np.matmul((offset * weight[..., None]).transpose(0, 2, 1), offset)
    variances, axes = np.linalg.eigh(scatter)
    return centre, np.maximum(variances, 1e-18), axes


def _best_support(
    points: Float, usable: Flags, vertical: Float, least_cosine: float, tolerance_m: float
) -> tuple[Flags, Flags]:
    """Find the best of many planes through three random points of each set.

    Returns:
        (T, N) inliers of the best plane, and (T,) whether any plane was flat enough.
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
    best = (near.sum(2) - _PENALTY_BELOW * below.sum(2)).argmax(1)
    return np.asarray(near[np.arange(len(points)), best]), np.asarray(flat.any(axis=1))
