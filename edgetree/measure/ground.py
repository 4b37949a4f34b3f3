"""The ground around the stems' bases, and heights above it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import CAMERA_UP, GroundPlane, GroundPlaneFailure, fit_ground_planes, project_points
from edgetree.measure.estimates import Estimate, Failure
from edgetree.measure.frame import DepthFrame

__all__ = ["BaseGround", "find_grounds"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

# Ground is looked for this far around the stem; only where that is hidden, further away, since
# the ground is no plane and heights err with the distance.
_REACHES_M = (0.6, 1.4)
# How far above and below the felling cut ground may lie.
_ABOVE_CUT_M = 0.3
_BELOW_CUT_M = 1.5
# Where to look: so many rows and columns of places, crowded towards the stem; more of them where
# the depth is too sparse for the first.
_GRIDS, _CROWDING = (19, 72), 1.5
_SPARSE = 0.3
_LEAST_POINTS, _MOST_POINTS = 20, 140
_TOLERANCE_M = 0.05
# The plane is never known better: litter, moss and roots lie on it.
_LITTER_STD_M = 0.02
_POINTS_PER_ERROR = 8.0
# Where much of what is seen is not in the plane it may be the top of plants: heights are doubted
# by this, times the square of that share.
_DOUBT_M = 0.35
_LEAST_MEETING = 0.2


@dataclass(frozen=True, eq=False)
class BaseGround:
    """The ground plane at a stem, and the vertical that heights are taken along.

    Attributes:
        plane: fitted to the depth around the base.
        up: (3,) unit vector away from gravity, in the camera's frame.
        reach_m: how far around the stem it was looked at.
        level: whether the plane's own normal stands in for the vertical.
    """

    plane: GroundPlane
    up: Float
    reach_m: float
    level: bool

    def height_m(
        self, axis_point: Float, along: Float, radius_m: float, axis_std_m: float
    ) -> Estimate | Failure:
        """Height of a point (3,) of the axis above the ground on the stem's uphill side.

        The axis, (3,) unit `along`, is followed to the ground; there the ground rises by the
        radius times its slope towards the uphill side.
        """
        meeting = float(self.plane.normal @ along)
        if meeting < _LEAST_MEETING:
            return Failure("the stem lies along the ground")
        length = float(self.plane.height_m(axis_point)) / meeting
        foot = axis_point - length * along
        value = length * float(along @ self.up) - self._uphill_m(radius_m)
        plane_std_m = float(self.plane.height_std_m(foot))
        doubt_m = _DOUBT_M * (1 - self.plane.inlier_fraction) ** 2
        return Estimate(value, math.hypot(plane_std_m, doubt_m, _LITTER_STD_M, axis_std_m))

    def axis_length_m(
        self, axis_point: Float, along: Float, radius_m: float, height: float
    ) -> float:
        """How far up the axis from a point (3,) of it the height above the uphill side lies."""
        meeting = max(float(self.plane.normal @ along), _LEAST_MEETING)
        foot = -float(self.plane.height_m(axis_point)) / meeting
        climb = max(float(along @ self.up), _LEAST_MEETING)
        return foot + (height + self._uphill_m(radius_m)) / climb

    def _uphill_m(self, radius_m: float) -> float:
        """How much higher the ground is at the stem's uphill side than at its axis."""
        steepness = float(self.plane.normal @ self.up)
        return radius_m * math.sqrt(max(1 - steepness**2, 0.0)) / steepness

    def in_words(self) -> str:
        """What heights refer to."""
        vertical = "across it" if self.level else "along the given vertical"
        residual_cm = 100 * self.plane.residual_std_m
        return (
            f"plane within {self.reach_m:.1f} m of the stem, {self.plane.points} points"
            f" ({self.plane.inlier_fraction:.0%} there) ± {residual_cm:.1f} cm, heights {vertical}"
        )


def find_grounds(
    frame: DepthFrame, axis_points: Float, radii_m: Float, up: Float | None
) -> list[BaseGround | Failure]:
    """The ground next to each stem, or where that does not show, further around it.

    Args:
        frame: depth, camera and masks.
        axis_points: (T, 3) on the axes at the felling cuts.
        radii_m: (T,) of the stems.
        up: (3,) the vertical; None takes the planes' normals for it.
    """
    vertical = np.array(CAMERA_UP) if up is None else up
    grounds: list[BaseGround | Failure] = [Failure("no ground around the base")] * len(radii_m)
    missing = np.arange(len(radii_m))
    for grid in _GRIDS:
        near, far = (reach_m + radii_m[missing] for reach_m in _REACHES_M)
        around = axis_points[missing]
        points, usable, level, sparse = _points_around(frame, around, far, vertical, grid)
        close = usable & (level < near[:, None])
        enough = close.sum(1) >= _LEAST_POINTS
        found = _fit_grounds(frame, points, np.where(enough[:, None], close, usable), enough, up)
        again = np.flatnonzero([not ground for ground in found] & enough)
        if len(again):
            wider = _fit_grounds(frame, points[again], usable[again], ~enough[again], up)
            for place, ground in zip(again, wider, strict=True):
                found[place] = ground
        for place, ground in zip(missing, found, strict=True):
            grounds[place] = ground
        missing = missing[sparse & (usable.sum(1) < _LEAST_POINTS)]
        if not len(missing):
            break
    return grounds


def _fit_grounds(
    frame: DepthFrame, points: Float, usable: Flags, close: Flags, up: Float | None
) -> list[BaseGround | Failure]:
    """Planes through the usable ones of (T, N, 3) points, which are `close` (T,) by or further."""
    points, usable = _thinned(points, usable)
    planes = fit_ground_planes(
        points, usable, up, frame.settings.max_slope_deg, _TOLERANCE_M, _POINTS_PER_ERROR
    )
    return [
        Failure(f"no ground around the base: {plane.reason}")
        if isinstance(plane, GroundPlaneFailure)
        else BaseGround(
            plane, plane.normal if up is None else up, _REACHES_M[0 if near else 1], up is None
        )
        for plane, near in zip(planes, close, strict=True)
    ]


def _points_around(
    frame: DepthFrame, axis_points: Float, reach_m: Float, vertical: Float, grid: int
) -> tuple[Float, Flags, Float, Flags]:
    """Camera points (T, N, 3) of `grid` rows and columns of places around axis points (T, 3),
    which (T, N) may be ground, how far they lie off on the level, and (T,) whether most have no
    reading.
    """
    ahead = np.maximum(axis_points[:, 2], 0.05)
    middle = project_points(frame.camera, np.stack([*axis_points.T[:2], ahead], -1))
    size = np.array([frame.camera.width, frame.camera.height])
    reach_px = (frame.camera.fx * reach_m / ahead)[:, None]
    low = np.clip(middle - reach_px, 0, size)[:, None]
    high = np.clip(middle + reach_px, 0, size)[:, None]
    ticks = np.linspace(-1.0, 1.0, grid)
    ticks = (1 + np.sign(ticks) * np.abs(ticks) ** _CROWDING) / 2
    xy_px = low + (high - low) * np.stack(np.meshgrid(ticks, ticks), -1).reshape(1, -1, 2)
    rays, depth_m = frame.readings(xy_px)
    points = rays * depth_m[..., None]
    offset = points - axis_points[:, None]
    rise = offset @ vertical
    level = np.sqrt(np.maximum((offset**2).sum(2) - rise**2, 0.0))
    beside = ~frame.on_any_stem(xy_px)
    sparse = ((depth_m > 0) & beside).sum(1) < _SPARSE * beside.sum(1)
    usable = beside & (depth_m > 0) & (level < reach_m[:, None]) & (axis_points[:, 2:] > 0)
    usable &= (rise < _ABOVE_CUT_M) & (rise > -_BELOW_CUT_M)
    return points, usable, level, sparse


def _thinned(points: Float, usable: Flags) -> tuple[Float, Flags]:
    """At most so many usable points of each stem, evenly picked."""
    order = np.argsort(~usable, axis=1, kind="stable")
    count = usable.sum(1)
    taken = np.minimum(count, _MOST_POINTS)
    place = np.arange(_MOST_POINTS)[None] * (count / np.maximum(taken, 1))[:, None]
    kept = np.arange(_MOST_POINTS)[None] < taken[:, None]
    place = np.where(kept, place, 0).astype(np.intp)
    picked = np.take_along_axis(order, place, 1)
    return np.take_along_axis(points, picked[..., None], 1), kept
