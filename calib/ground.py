"""Robust fit of the ground plane to camera points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Bool, Float, Index
from basetree.errors import InputError
from calib.directions import CAMERA_UP, cross
from calib.errors import Failure
from calib.ground_cloud import GroundCloud

_MIN_POINTS = 12
_MIN_INLIER_SHARE = 0.1
_REFINEMENTS = 3
_MIN_WIDTH_RATIO = 0.01  # of the points' spread across to the spread along
# Share of ground among the points to begin with.
_GROUND_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """Plane of the points p with `normal` . p + `offset_m` = 0, in camera coordinates.

    Attributes:
        normal: (3,) unit vector pointing up.
        offset_m: Height of the camera above the plane, in metres.
        residual_std_m: Root mean square distance of the inliers from the plane, by weight.
        inlier_fraction: Share of the usable points that are inliers.
        above_fraction: Share of the usable points that are above the plane, for example plants.
        points: Number of inliers.
        independent_points: Number of inliers with independent errors, by weight.
        centre_m: (3,) weighted mean of the inliers.
        axes: (2, 3) unit vectors in the plane: the principal axes of the inliers.
        extents_m: (2,) weighted standard deviations of the inliers along `axes`.
    """

    normal: Float
    offset_m: float
    residual_std_m: float
    inlier_fraction: float
    above_fraction: float
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
        offset_m /= self.extents_m
        leverage = 1 + np.vecdot(offset_m, offset_m)
        return np.asarray(self.residual_std_m * np.sqrt(leverage / self.independent_points))


class GroundPlaneFailure(Failure):
    """The reason why no ground plane was found. Falsy."""


def fit_ground_plane(
    points_m: ArrayLike,
    up: ArrayLike | None = None,
    max_slope_deg: float = 45.0,
    tolerance_m: float = 0.06,
) -> GroundPlane | GroundPlaneFailure:
    """Fit the lowest plane that many points support.

    Points above the plane may be plants, hedges or walls; points below it are errors. Trial planes
    through three of the lowest points of their surroundings (RANSAC) are scored by a truncated
    squared distance, with a higher limit below the plane. The best one is refined by weighted
    least squares: a point's weight is the probability that it is ground, in a mixture of ground
    (normally distributed), plants (uniform above the ground) and errors (expectation
    maximisation). The result is deterministic.

    Args:
        points_m: (N, 3) camera points in metres; rows that are not finite are ignored.
        up: (3,) direction away from gravity in camera coordinates, from an IMU or the mounting. The
            default is the camera's own up, (0, -1, 0).
        max_slope_deg: Largest angle between the plane's normal and `up`.
        tolerance_m: Largest distance of ground points from the plane: three standard deviations of
            the ground's unevenness.

    Returns:
        The plane, or a falsy GroundPlaneFailure if there are fewer than 12 points, if they lie on a
        line, if every plane is too steep, or if less than 10 % of the points are inliers.

    Raises:
        InputError: If `up` is not a direction.

    Examples:
        >>> import numpy as np
        >>> from calib import CAMERA_UP, fit_ground_plane
        >>> grid = np.mgrid[-2:2:40j, 2:8:40j]
        >>> points_m = np.stack([grid[0], np.full_like(grid[0], 1.8), grid[1]], axis=-1)
        >>> plane = fit_ground_plane(points_m, CAMERA_UP)
        >>> plane.height_m([0.0, 0.0, 5.0]).round(2)  # the camera hangs 1.8 m above it
        np.float64(1.8)
    """
    points = np.asarray(points_m, np.float64).reshape(1, -1, 3)
    usable = np.asarray(np.isfinite(points).all(axis=2))
    return fit_ground_planes(points, usable, up, max_slope_deg, tolerance_m)[0]


def fit_ground_planes(
    points_m: Float,
    usable: Bool,
    up: ArrayLike | None = None,
    max_slope_deg: float = 45.0,
    tolerance_m: float = 0.06,
    points_per_error: float = 1.0,
    depth_std_m: ArrayLike = 0.0,
    departure_std_m: ArrayLike = 0.0,
) -> list[GroundPlane | GroundPlaneFailure]:
    """Fit a plane to each of T sets of points at once; see `fit_ground_plane`.

    Args:
        points_m: (T, N, 3) camera points in metres.
        usable: (T, N) bool, the points to use.
        up: (3,) direction away from gravity in camera coordinates.
        max_slope_deg: Largest angle between a plane's normal and `up`.
        tolerance_m: Largest distance of ground points from their plane, without errors of depth.
        points_per_error: Number of neighbouring points that share one error of the sensor; it
            lowers `independent_points`.
        depth_std_m: (T, N) or scalar standard deviation of the depth, which enlarges the tolerance.
        departure_std_m: (T, N) or scalar standard deviation by which the ground itself leaves the
            plane at a point. It lowers the point's weight: ground that is not flat is fitted best
            where this is small.

    Returns:
        A plane or a GroundPlaneFailure for each set.

    Raises:
        InputError: If `up` is not a direction.
    """
    vertical = _direction(CAMERA_UP if up is None else up)
    if not points_m.shape[1]:
        few = f"0 ground points, expected at least {_MIN_POINTS}"
        return [GroundPlaneFailure(few)] * len(points_m)
    points = np.where(usable[..., None], points_m, 0.0)
    depth = np.where(usable, points[..., 2], 1.0)
    noise = np.where(usable, np.asarray(depth_std_m) / np.maximum(np.abs(depth), 1e-9), 0.0)
    level_axes = _level_axes(vertical)
    departure = np.broadcast_to(np.asarray(departure_std_m, np.float64), usable.shape)
    level = points @ level_axes.T
    cloud = GroundCloud(level, _by_axis(level), usable, noise, departure, tolerance_m)
    normal, offset, flat = cloud.best_trial(float(np.cos(np.radians(max_slope_deg))))
    ground_share, number = np.full(len(points), _GROUND_SHARE), np.maximum(usable.sum(1), 1)
    for _ in range(_REFINEMENTS):
        ground, _, variance = cloud.probabilities(normal, offset, ground_share)
        ground_share = ground.sum(1) / number
        normal, offset = cloud.regression(ground / variance, normal, offset)
    ground, plants, variance = cloud.probabilities(normal, offset, ground_share)
    support, normal = ground > 0.5, normal @ level_axes
    weight = support * (1 - departure**2 / variance)
    centre, variances, axes = _principal_axes(points, weight)
    squares = (np.matmul(points, normal[..., None])[..., 0] + offset[:, None]) ** 2
    fits = _Fits(
        usable=usable.sum(1),
        flat=flat,
        variances=variances,
        axes=axes,
        centre=centre,
        normal=normal,
        offset=offset,
        support=support.sum(1),
        weight=weight.sum(1),
        squares=(weight * squares).sum(1),
        above=plants.sum(1) / number,
    )
    return [
        fits.plane(index, points_per_error, max_slope_deg, vertical) for index in range(len(points))
    ]


class _Fits(NamedTuple):
    """Planes fitted to T sets of points.

    Attributes:
        usable: (T,) number of usable points.
        flat: (T,) whether any trial plane was flat enough.
        variances: (T, 3) variances along `axes`, ascending.
        axes: (T, 3, 3) principal axes in columns.
        centre: (T, 3) means of the inliers.
        normal: (T, 3) unit normals pointing up.
        offset: (T,) plane offsets in metres.
        support: (T,) numbers of inliers.
        weight: (T,) sums of their weights: 1 where the ground does not leave the plane.
        squares: (T,) sums of their squared distances from the planes, by weight.
        above: (T,) shares of the points that are above the planes.
    """

    usable: Index
    flat: Bool
    variances: Float
    axes: Float
    centre: Float
    normal: Float
    offset: Float
    support: Index
    weight: Float
    squares: Float
    above: Float

    def plane(
        self, at: int, points_per_error: float, max_slope_deg: float, vertical: Float
    ) -> GroundPlane | GroundPlaneFailure:
        """Return the plane of set `at`, or the reason why there is none."""
        normal, variances = self.normal[at], self.variances[at]
        held = int(self.support[at])
        share = held / max(int(self.usable[at]), 1)
        if self.usable[at] < _MIN_POINTS:
            few = f"{self.usable[at]} ground points, expected at least {_MIN_POINTS}"
            return GroundPlaneFailure(few)
        if not self.flat[at]:
            return GroundPlaneFailure(f"no plane flatter than {max_slope_deg:g} degrees")
        if share < _MIN_INLIER_SHARE:
            return GroundPlaneFailure(
                f"the best plane holds {share:.0%} of the points, expected {_MIN_INLIER_SHARE:.0%}"
            )
        if variances[1] < _MIN_WIDTH_RATIO**2 * variances[2]:
            return GroundPlaneFailure("the ground points lie on one line")
        if normal @ vertical < math.cos(math.radians(max_slope_deg)):
            return GroundPlaneFailure(f"no plane flatter than {max_slope_deg:g} degrees")
        total = float(self.weight[at])
        independent = max(total / points_per_error, 1.0)
        return GroundPlane(
            normal,
            float(self.offset[at]),
            math.sqrt(float(self.squares[at]) / total),
            share,
            float(self.above[at]),
            held,
            independent,
            self.centre[at],
            self.axes[at, :, 1:].T,
            np.sqrt(variances[1:]),
        )


def _direction(up: ArrayLike) -> Float:
    """Return `up` normalised to unit length."""
    vertical = np.asarray(up, np.float64)
    length = float(np.linalg.norm(vertical)) if vertical.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0):
        raise InputError(f"up is {vertical.tolist()}: expected a direction of three numbers")
    return vertical / length


def _level_axes(vertical: Float) -> Float:
    """(3, 3) rotation to axes of which the third one is the vertical."""
    first = cross(vertical, np.eye(3)[np.abs(vertical).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([first, cross(vertical, first), vertical])


def _by_axis(points: Float) -> Float:
    """(T, 3, N) copy of (T, N, 3) points, with the values of one coordinate side by side."""
    return np.ascontiguousarray(points.transpose(0, 2, 1))


def _principal_axes(points: Float, weight: Float) -> tuple[Float, Float, Float]:
    """Return the principal axes of the supporting points of each set.

    Returns:
        Means (T, 3), variances along the axes (T, 3) in ascending order, and axes (T, 3, 3) in
        columns.
    """
    weight = weight / np.maximum(weight.sum(1, keepdims=True), 1e-9)
    centre = np.matmul(weight[:, None], points)[:, 0]
    offset = _by_axis(points) - centre[..., None]
    scatter = np.matmul(offset * weight[:, None], offset.transpose(0, 2, 1))
    variances, axes = np.linalg.eigh(scatter)
    return centre, np.maximum(variances, 1e-18), axes
