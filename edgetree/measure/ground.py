"""Fit the ground around the bases of stems, and measure heights above it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib import GroundPlane, GroundPlaneFailure, fit_ground_planes, project_points
from edgetree.measure.estimates import Estimate, Failure
from edgetree.measure.frame import DepthFrame
from edgetree.measure.vertical import Vertical, Verticals

__all__ = ["BaseGround", "find_grounds"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

# Ground is searched for within the first distance around the stem, and within the second only if
# that is hidden: ground is not flat, so heights get less accurate with the distance.
_SEARCH_RADII_M = (0.9, 1.4)
# Ground points are at most this far above and below the felling cut.
_MAX_ABOVE_CUT_M = 0.3
_MAX_BELOW_CUT_M = 1.5
# Rows and columns of the sampling grid, which is denser towards the stem by this exponent. The
# second grid is for depth with readings at less than this fraction of the first grid's points.
_GRIDS, _GRID_EXPONENT = (23, 72), 1.5
_SPARSE = 0.3
_MIN_POINTS, _MAX_POINTS = 20, 150
_TOLERANCE_M = 0.05
# Smallest standard deviation of the ground's height: litter, moss and roots.
_LITTER_STD_M = 0.02
_POINTS_PER_ERROR = 36.0
# Points off the plane may mean that plants hide the ground. Standard deviation of the height, times
# the squared fraction of such points.
_OUTLIER_STD_M = 0.15
# From this fraction of points above the plane on, plants hide the ground.
_MIN_PLANTS = 0.3
# Smallest cosine of the angle between an axis and the ground's normal, or the vertical.
_MIN_COSINE = 0.2


@dataclass(frozen=True, eq=False)
class BaseGround:
    """The ground plane at a stem, and the vertical along which heights are measured.

    Attributes:
        plane: plane fitted to the depth around the base.
        vertical: the vertical at the stem.
        reach_m: distance from the stem within which ground points were used.
    """

    plane: GroundPlane
    vertical: Vertical
    reach_m: float

    @property
    def up(self) -> Float:
        """(3,) unit vector away from gravity, in camera coordinates."""
        return self.vertical.up

    @property
    def overgrown(self) -> bool:
        """Whether plants hide a large part of the ground."""
        return self.plane.above_fraction > _MIN_PLANTS

    def height_m(
        self, axis_point: Float, along: Float, radius_m: float, axis_std_m: float
    ) -> Estimate | Failure:
        """Height of a point of the axis above the ground on the stem's uphill side.

        The axis is followed to where it meets the plane. On the uphill side of the stem the
        ground is higher by the radius times the tangent of its slope.

        Args:
            axis_point: (3,) camera point on the axis.
            along: (3,) unit vector up the axis.
            radius_m: radius of the stem.
            axis_std_m: standard deviation of the point's height.

        Returns:
            The height in metres along the vertical, or why there is none.
        """
        cosine = float(self.plane.normal @ along)
        if cosine < _MIN_COSINE:
            return Failure("the stem lies along the ground")
        length = float(self.plane.height_m(axis_point)) / cosine
        foot = axis_point - length * along
        value = length * float(along @ self.up) - self.uphill_m(radius_m)
        plane_std_m = float(self.plane.height_std_m(foot))
        outlier_std_m = _OUTLIER_STD_M * (1 - self.plane.inlier_fraction) ** 2
        # An error of the vertical changes the slope by as much.
        uphill_std_m = radius_m * self.vertical.tilt_std_rad
        parts = (plane_std_m, outlier_std_m, uphill_std_m, _LITTER_STD_M, axis_std_m)
        return Estimate(value, math.hypot(*parts))

    def axis_length_m(
        self, axis_point: Float, along: Float, radius_m: float, height_m: float
    ) -> float:
        """Distance along the axis from a point of it up to a height, the inverse of `height_m`.

        Args:
            axis_point: (3,) camera point on the axis.
            along: (3,) unit vector up the axis.
            radius_m: radius of the stem.
            height_m: height above the ground on the uphill side, along the vertical.
        """
        cosine = max(float(self.plane.normal @ along), _MIN_COSINE)
        foot_m = -float(self.plane.height_m(axis_point)) / cosine
        up_cosine = max(float(along @ self.up), _MIN_COSINE)
        return foot_m + (height_m + self.uphill_m(radius_m)) / up_cosine

    def uphill_m(self, radius_m: float) -> float:
        """Height of the ground on the stem's uphill side above that at its axis: r tan(slope)."""
        cos_slope = float(self.plane.normal @ self.up)
        return radius_m * math.sqrt(max(1 - cos_slope**2, 0.0)) / cos_slope

    def description(self) -> str:
        """The plane, and the direction along which heights are measured, as text."""
        residual_cm = 100 * self.plane.residual_std_m
        return (
            f"plane within {self.reach_m:.1f} m of the stem, {self.plane.points} points"
            f" ({self.plane.inlier_fraction:.0%} there) ± {residual_cm:.1f} cm, heights along"
            f" {self.vertical.description()}"
        )


def find_grounds(
    frame: DepthFrame,
    axis_points: Float,
    radii_m: Float,
    verticals: Verticals,
    indices: NDArray[np.intp],
) -> list[BaseGround | Failure]:
    """Fit the ground next to each stem, or further around it where that is hidden.

    Args:
        frame: depth, camera and masks.
        axis_points: (T, 3) camera points on the axes at the felling cuts.
        radii_m: (T,) radii of the stems.
        verticals: the verticals of all stems of the frame.
        indices: (T,) numbers of these stems in it.

    Returns:
        T grounds, or why there is none.
    """
    up = verticals.common
    grounds: list[BaseGround | Failure] = [Failure("no ground around the base")] * len(radii_m)
    missing = np.arange(len(radii_m))
    for grid in _GRIDS:
        near, far = (radius_m + radii_m[missing] for radius_m in _SEARCH_RADII_M)
        samples = _sample_around(frame, axis_points[missing], far, up, grid)
        points, usable = samples.points, samples.usable
        close = usable & (samples.level_m < near[:, None])
        enough = close.sum(1) >= _MIN_POINTS
        found = _fit_planes(frame, points, np.where(enough[:, None], close, usable), enough, up)
        again = np.flatnonzero([not ground for ground in found] & enough)
        if len(again):
            wider = _fit_planes(frame, points[again], usable[again], ~enough[again], up)
            for index, plane in zip(again, wider, strict=True):
                found[index] = plane
        for index, plane in zip(missing, found, strict=True):
            grounds[index] = (
                plane
                if isinstance(plane, Failure)
                else BaseGround(
                    plane[0], verticals.at(int(indices[index]), plane[0].normal), plane[1]
                )
            )
        missing = missing[samples.sparse & (usable.sum(1) < _MIN_POINTS)]
        if not len(missing):
            break
    return grounds


def _fit_planes(
    frame: DepthFrame, points: Float, usable: Flags, close: Flags, up: Float
) -> list[tuple[GroundPlane, float] | Failure]:
    """Fit planes to the usable ones of (T, N, 3) points.

    `close` (T,) tells which of the two search radii the points are from.

    Returns:
        T planes with their search radii, or why there is none.
    """
    points, usable = _thinned(points, usable)
    settings = frame.settings
    depth_std_m = np.hypot(settings.depth_noise_m, settings.depth_noise_per_m * points[..., 2] ** 2)
    planes = fit_ground_planes(
        points, usable, up, settings.max_slope_deg, _TOLERANCE_M, _POINTS_PER_ERROR, depth_std_m
    )
    return [
        Failure(f"no ground around the base: {plane.reason}")
        if isinstance(plane, GroundPlaneFailure)
        else (plane, _SEARCH_RADII_M[0 if near else 1])
        for plane, near in zip(planes, close, strict=True)
    ]


class _GroundSamples(NamedTuple):
    """Samples of the depth around T stems.

    Attributes:
        points: (T, N, 3) camera points in metres.
        usable: (T, N) whether the point may be ground.
        level_m: (T, N) horizontal distance from the axis point.
        sparse: (T,) whether most of the samples have no depth reading.
    """

    points: Float
    usable: Flags
    level_m: Float
    sparse: Flags


def _sample_around(
    frame: DepthFrame, axis_points: Float, reach_m: Float, vertical: Float, grid: int
) -> _GroundSamples:
    """Sample the depth on a grid of `grid` rows and columns around axis points (T, 3)."""
    ahead = np.maximum(axis_points[:, 2], 0.05)
    middle = project_points(frame.camera, np.stack([*axis_points.T[:2], ahead], -1))
    # From the centre of the first pixel to that of the last: a point on the border itself lies on
    # no mask, so the stem's own depth there would pass for ground.
    last = np.array([frame.camera.width, frame.camera.height]) - 0.5
    reach_px = (frame.camera.fx * reach_m / ahead)[:, None]
    low = np.clip(middle - reach_px, 0.5, last)[:, None]
    high = np.clip(middle + reach_px, 0.5, last)[:, None]
    ticks = np.linspace(-1.0, 1.0, grid)
    ticks = (1 + np.sign(ticks) * np.abs(ticks) ** _GRID_EXPONENT) / 2
    xy_px = low + (high - low) * np.stack(np.meshgrid(ticks, ticks), -1).reshape(1, -1, 2)
    rays, depth_m = frame.readings(xy_px)
    points = rays * depth_m[..., None]
    offset = points - axis_points[:, None]
    rise = offset @ vertical
    level_m = np.sqrt(np.maximum((offset**2).sum(2) - rise**2, 0.0))
    beside = ~frame.on_any_stem(xy_px)
    sparse = ((depth_m > 0) & beside).sum(1) < _SPARSE * beside.sum(1)
    usable = beside & (depth_m > 0) & (level_m < reach_m[:, None]) & (axis_points[:, 2:] > 0)
    usable &= (rise < _MAX_ABOVE_CUT_M) & (rise > -_MAX_BELOW_CUT_M)
    return _GroundSamples(points, usable, level_m, sparse)


def _thinned(points: Float, usable: Flags) -> tuple[Float, Flags]:
    """At most `_MAX_POINTS` usable ones of (T, N, 3) points, evenly spread over the N.

    Returns:
        (T, M, 3) points, and (T, M) which of them are filled.
    """
    order = np.argsort(~usable, axis=1, kind="stable")
    count = usable.sum(1)
    taken = np.minimum(count, _MAX_POINTS)
    rank = np.arange(_MAX_POINTS)[None] * (count / np.maximum(taken, 1))[:, None]
    kept = np.arange(_MAX_POINTS)[None] < taken[:, None]
    rank = np.where(kept, rank, 0).astype(np.intp)
    picked = np.take_along_axis(order, rank, 1)
    return np.take_along_axis(points, picked[..., None], 1), kept
