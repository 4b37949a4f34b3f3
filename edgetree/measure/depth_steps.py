"""The steps of a depth image: the pixels that share a reading, and those of disparities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Float, Index
from edgetree.measure.edge_lines import fit_lines

# So many rows are looked at.
_ROWS = 32
# A reading fills squares of up to so many pixels. They are found if at least so many neighbours
# differ, and this share of these differ at the sides of squares.
_MAX_SIDE, _MIN_CHANGES, _AT_SIDES = 4, 100, 0.98
# Steps are counted in ranges of depth that each end at this factor times their start, in mm.
_RANGES_MM = np.unique(np.rint(1000 * 1.08 ** np.arange(36)).astype(np.intp))
# The step of a range is known if a value in it is so common, in the mean.
_MIN_COUNT, _MIN_VALUES = 4, 2
# Steps of disparities grow with the square of the depth: this power or more, in so many ranges.
# They are told from those of the file format if they are so large, in mm.
_MIN_POWER, _MIN_RANGES, _MIN_STEP_MM = 1.4, 8, 4.0


class DepthSteps(NamedTuple):
    """The steps of a depth image.

    Attributes:
        side_px: Side of the squares of pixels that share one reading, as in enlarged depth images.
        of_disparities: Whether the steps of the depth grow with its square, as those of stereo.
    """

    side_px: int
    of_disparities: bool


def depth_steps(depth_m: Float) -> DepthSteps:
    """The steps of a depth image (H, W) in metres."""
    rows = depth_m[:: max(len(depth_m) // _ROWS, 1)]
    left, right = rows[:, :-1], rows[:, 1:]
    read = rows > 0
    changes = np.count_nonzero((left != right) & read[:, :-1] & read[:, 1:], axis=0)
    return DepthSteps(_side_px(changes), _of_disparities(rows))


def _side_px(changes: Index) -> int:
    """The side of squares, from the number of changes at each column."""
    for side in range(_MAX_SIDE, 1, -1):
        at_side = np.bincount(np.arange(len(changes)) % side, changes, side)
        if at_side.max() >= max(_AT_SIDES * changes.sum(), _MIN_CHANGES):
            return side
    return 1


def _of_disparities(depth_m: Float) -> bool:
    """Whether depths (R, W) step as disparities do."""
    # Others count below the first range, or at the end of the last one, which is cut off.
    depth_mm = np.rint(np.fmin(np.fmax(1000 * depth_m, 0.0), _RANGES_MM[-1])).astype(np.intp)
    counts = np.bincount(depth_mm.ravel(), minlength=_RANGES_MM[-1] + 1)[: _RANGES_MM[-1]]
    number = np.add.reduceat(counts, _RANGES_MM[:-1])
    values = np.add.reduceat(np.minimum(counts, 1), _RANGES_MM[:-1])
    known = (number >= _MIN_COUNT * values) & (values >= _MIN_VALUES)
    if known.sum() < _MIN_RANGES:
        return False
    step_mm = (np.diff(_RANGES_MM) / np.maximum(values, 1))[known]
    ranges_mm = _RANGES_MM[:-1][known]
    power = fit_lines(np.log(ranges_mm), np.log(step_mm), np.ones(len(step_mm)))[1]
    return bool(power >= _MIN_POWER and np.median(step_mm) >= _MIN_STEP_MM)
