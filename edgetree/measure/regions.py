"""Regions of the image in which the edges of stems are searched for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.frame import MASK_THRESHOLD, MaskGrid

__all__ = [
    "MIN_HALF_PX",
    "OUTWARDS",
    "STATIONS",
    "SearchRegions",
    "clean_rows",
    "line_spans",
    "mask_moments",
]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

STATIONS = 24
"""Number of cross-lines along every stem, at which its edges and depth are sampled.

It is a multiple of four, because lines are searched for in halves and quarters of a stem.
"""

OUTWARDS = np.array([-1.0, 1.0])[:, None, None]
"""Direction across a region in which the left and the right edge face away from the stem."""

# Aspect ratio of a mask below which the direction from its moments is not trusted alone.
_MIN_ASPECT = 2.2
# Neighbouring rows of a mask belong together if their edges differ by less than this fraction of
# their width, or this many cells. So many rows, and so many per width, make a stem.
_MAX_JUMP, _MAX_JUMP_CELLS = 0.05, 2.0
_MIN_ROWS, _MIN_ROWS_PER_WIDTH = 8, 0.3
MIN_HALF_PX = 0.5
"""Smallest half width of a region."""


@dataclass(frozen=True, eq=False)
class SearchRegions:
    """Straight regions of the image around T stems, in which their edges are searched for.

    Attributes:
        origin_px: (T, 2) a point on the region's centre line.
        along: (T, 2) unit vector of the centre line, up the stem.
        half_px: (T,) half the width.
        span_px: (T, 2) lowest and highest position along the centre line, from the origin.
    """

    origin_px: Float
    along: Float
    half_px: Float
    span_px: Float

    @cached_property
    def across(self) -> Float:
        """(T, 2) unit vector at right angles to the centre line, to the right of the stem."""
        return np.stack([-self.along[:, 1], self.along[:, 0]], -1)

    @property
    def arrays(self) -> tuple[Float, Float, Float, Float]:
        """All arrays, in the order of the attributes."""
        return self.origin_px, self.along, self.half_px, self.span_px

    @cached_property
    def stations_px(self) -> Float:
        """(T, S) evenly spaced positions along the centre line, from low to high."""
        fraction = (np.arange(STATIONS) + 0.5) / STATIONS
        low, high = self.span_px[:, :1], self.span_px[:, 1:]
        return np.asarray(low + (high - low) * fraction)

    def points(self, across_px: Float) -> Float:
        """Image points at the stations.

        Args:
            across_px: (..., T, S, C) offsets from the centre line, positive to the right.

        Returns:
            (..., T, S, C, 2) points in pixels; in memory, all x lie before all y.
        """
        line = self.origin_px[:, None] + self.stations_px[..., None] * self.along[:, None]
        points = np.empty((2, *across_px.shape))
        for axis in (0, 1):
            np.multiply(across_px, self.across[:, axis, None, None], out=points[axis])
            points[axis] += line[..., axis, None]
        return np.moveaxis(points, 0, -1)


def line_spans(origin_px: Float, along: Float, boxes_px: Float) -> Float:
    """Where lines leave their boxes.

    Args:
        origin_px: (T, 2) points on the lines.
        along: (T, 2) unit vectors of the lines.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.

    Returns:
        (T, 2) positions along each line, from its origin: against its direction and in it.
    """
    safe = np.where(np.abs(along) < 1e-6, 1e-6, along)
    ends = (boxes_px.reshape(-1, 2, 2) - origin_px[:, None]) / safe[:, None]
    low, high = np.sort(ends, axis=1).transpose(1, 0, 2)
    return np.stack([low.max(1), high.min(1)], -1)


def mask_moments(mask: MaskGrid) -> tuple[Float, Float, Float, np.bool_]:
    """Centre line of one mask from its image moments.

    The half width is that of a rectangle of the same area, whose variance along its length L is
    L² / 12.

    Returns:
        Origin (2,), direction up the stem (2,), half width, and whether the mask is too short for
        its width to trust the direction.
    """
    weight = np.where(mask.grid >= MASK_THRESHOLD, mask.grid, 0.0)
    total = float(weight.sum())
    if total == 0:
        return mask.box_px[:2], np.array([0.0, -1.0]), np.array(MIN_HALF_PX), np.False_
    cell = (mask.box_px[2:] - mask.box_px[:2]) / mask.grid.shape[::-1]
    x = mask.box_px[0] + (np.arange(mask.grid.shape[1]) + 0.5) * cell[0]
    y = mask.box_px[1] + (np.arange(mask.grid.shape[0]) + 0.5) * cell[1]
    columns, rows = weight.sum(0), weight.sum(1)
    mean_x, mean_y = float(columns @ x) / total, float(rows @ y) / total
    mixed = float((y - mean_y) @ weight @ (x - mean_x)) / total
    covariance = np.array(
        [
            [float(columns @ (x - mean_x) ** 2) / total, mixed],
            [mixed, float(rows @ (y - mean_y) ** 2) / total],
        ]
    )
    variances, axes = np.linalg.eigh(covariance)
    along = axes[:, 1] * (-1.0 if axes[1, 1] > 0 else 1.0)
    half = total * cell[0] * cell[1] / np.sqrt(12 * max(variances[1], 1e-9)) / 2
    short = np.bool_(variances[1] < _MIN_ASPECT**2 * variances[0])
    return np.array([mean_x, mean_y]), along, np.asarray(max(half, MIN_HALF_PX)), short


def clean_rows(mask: MaskGrid, width_px: int) -> SearchRegions | None:
    """Region of the longest run of rows in which a mask has two smooth edges.

    For masks that show much else beside the stem in their other rows.

    Args:
        mask: the mask.
        width_px: width of the image; rows that reach its border are not clean.

    Returns:
        The region of one stem, which spans these rows alone, or None if there are too few.
    """
    inside = mask.grid >= MASK_THRESHOLD
    columns = inside.shape[1]
    left, right = inside.argmax(1), columns - inside[:, ::-1].argmax(1)
    cell = (mask.box_px[2:] - mask.box_px[:2]) / inside.shape[::-1]
    left_px, right_px = (mask.box_px[0] + side * cell[0] for side in (left, right))
    clean = (inside.sum(1) == right - left) & (left_px >= 1) & (right_px <= width_px - 1)
    jump = np.maximum(np.abs(np.diff(left)), np.abs(np.diff(right)))
    limit = np.maximum(_MAX_JUMP * (right - left)[1:], _MAX_JUMP_CELLS)
    joined = clean[1:] & clean[:-1] & (jump <= limit)
    # Ends of the runs of joined rows.
    change = np.flatnonzero(np.diff(np.concatenate([[False], joined, [False]])))
    if not len(change):
        return None
    starts, ends = change[::2], change[1::2] + 1
    longest = int((ends - starts).argmax())
    rows = np.arange(starts[longest], ends[longest])
    y_px = mask.box_px[1] + (rows + 0.5) * cell[1]
    width = float(np.median(right_px[rows] - left_px[rows]))
    if len(rows) < _MIN_ROWS or y_px[-1] - y_px[0] < _MIN_ROWS_PER_WIDTH * width:
        return None
    slope, middle = np.polyfit(y_px - y_px.mean(), (left_px + right_px)[rows] / 2, 1)
    length = float(np.hypot(1.0, slope))
    reach = (y_px[-1] - y_px[0]) / 2 * length
    return SearchRegions(
        np.array([[middle, y_px.mean()]]),
        np.array([[-slope, -1.0]]) / length,
        np.array([width / length / 2]),
        np.array([[-reach, reach]]),
    )
