"""Sample the depth around the bases of stems."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from calib import project_points
from edgetree.measure.beams import beams_within
from edgetree.measure.constants.ground import MAX_ABOVE_CUT_M, MAX_BELOW_CUT_M
from edgetree.measure.frame import DepthFrame

# The grid is denser towards the stem by this exponent. It reaches less far up and down, by this
# factor, because the ground is seen from the side. Both were chosen on 791 simulated frames.
_GRID_EXPONENT, _REACH_UP = 1.2, 0.6
# Depth is sparse if there are readings at less than this fraction of the grid's points.
_SPARSE = 0.3
# More points cost time and hardly change a plane.
_MAX_POINTS = 150


class GroundSamples(NamedTuple):
    """Samples of the depth around T stems.

    Attributes:
        points: (T, N, 3) camera points in metres.
        usable: (T, N) whether the point may be ground.
        level_m: (T, N) horizontal distance from the axis point.
        sparse: (T,) whether most of the samples have no depth reading.
    """

    points: Float
    usable: Bool
    level_m: Float
    sparse: Bool


class Axes(NamedTuple):
    """Axes of T stems.

    Attributes:
        points: (T, 3) axis points in metres.
        along: (T, 3) unit vectors.
        own_m: (T,) readings within this distance are of the stem itself.
    """

    points: Float
    along: Float
    own_m: Float


def sample_around(
    frame: DepthFrame, axes: Axes, reach_m: Float, vertical: Float, grid: int
) -> GroundSamples:
    """Sample the depth on a grid of `grid` rows and columns around points of axes."""
    axis_points = axes.points
    ahead = np.maximum(axis_points[:, 2], 0.05)
    middle = project_points(frame.camera, np.stack([*axis_points.T[:2], ahead], -1))
    first, last = frame.limits_px
    reach_px = (frame.camera.fx * reach_m / ahead)[:, None] * (1.0, _REACH_UP)
    low = np.clip(middle - reach_px, first, last)[:, None]
    high = np.clip(middle + reach_px, first, last)[:, None]
    ticks = np.linspace(-1.0, 1.0, grid)
    ticks = (1 + np.sign(ticks) * np.abs(ticks) ** _GRID_EXPONENT) / 2
    x_px, y_px = (low + (high - low) * ticks[:, None]).transpose(2, 0, 1)
    xy_by_axis = np.empty((2, len(ahead), grid, grid))
    xy_by_axis[0], xy_by_axis[1] = x_px[:, None], y_px[..., None]
    xy_px: Float = xy_by_axis.reshape(2, len(ahead), -1).transpose(1, 2, 0)
    if frame.is_sparse:
        xy_px = beams_within(frame, low[:, 0], high[:, 0], grid * grid)
    rays, depth_m = frame.readings(xy_px)
    points = rays * depth_m[..., None]
    offset = points - axis_points[:, None]
    # `np.vecdot` of such short vectors takes several times as long.
    rise, squared = offset @ vertical, offset**2 @ np.ones(3)
    level_m = np.sqrt(np.maximum(squared - rise**2, 0.0))
    beside = ~frame.on_any_stem(xy_px)
    sparse = ((depth_m > 0) & beside).sum(1) < _SPARSE * beside.sum(1)
    usable = beside & (depth_m > 0) & (level_m < reach_m[:, None]) & (axis_points[:, 2:] > 0)
    along_m = np.matmul(offset, axes.along[..., None])[..., 0]
    from_axis_m = np.sqrt(np.maximum(squared - along_m**2, 0.0))
    usable &= from_axis_m > axes.own_m[:, None]
    usable &= (rise < MAX_ABOVE_CUT_M) & (rise > -MAX_BELOW_CUT_M)
    return GroundSamples(points, usable, level_m, sparse)


def thinned(samples: GroundSamples) -> GroundSamples:
    """At most `_MAX_POINTS` of the usable samples, evenly spread, the usable ones first."""
    order = np.argsort(~samples.usable, axis=1, kind="stable")
    count = samples.usable.sum(1)
    taken = np.minimum(count, _MAX_POINTS)
    rank = np.arange(_MAX_POINTS)[None] * (count / np.maximum(taken, 1))[:, None]
    kept = np.arange(_MAX_POINTS)[None] < taken[:, None]
    rank = np.where(kept, rank, 0).astype(np.intp)
    picked = np.take_along_axis(order, rank, 1)
    points = samples.points[np.arange(len(picked))[:, None], picked]
    level_m = np.take_along_axis(samples.level_m, picked, 1)
    return GroundSamples(points, kept, level_m, samples.sparse)
