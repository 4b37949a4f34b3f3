"""The edges of a mask by row, and those of the surface on it that the depth shows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Float32, Index
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame, MaskGrid

# Rows and columns of the grid on which a mask and its depth are compared, at most.
_ROWS, _COLUMNS = 96, 160
# The depth is looked at beside the box, too, by this share of its width.
_BESIDE = 0.15
# Readings of one stem in a row differ by less than this share of its radius from one to the next,
# also over gaps of this share of its width: else another surface begins.
_MAX_STEP, _MAX_GAP = 0.6, 0.35

NARROW = 0.25
"""The width of a stem is about that of the narrowest rows of its mask: this quantile."""


class MaskCells(NamedTuple):
    """A mask and the depth around it, on R rows and C columns.

    Attributes:
        x_px, y_px: (C,) and (R,) places of the centres of its cells.
        mask: (R, C) probabilities.
        depth_m: (R, C) readings; 0 where there is none.
    """

    x_px: Float
    y_px: Float
    mask: Float32
    depth_m: Float

    @property
    def column_px(self) -> float:
        """Width of a cell."""
        return float(self.x_px[1] - self.x_px[0]) if len(self.x_px) > 1 else 1.0

    @property
    def row_px(self) -> float:
        """Height of a cell."""
        return float(self.y_px[1] - self.y_px[0]) if len(self.y_px) > 1 else 1.0


class MaskLayers(NamedTuple):
    """Edges of one mask by row, in px; NaN where there are none.

    Attributes:
        grid: The mask and the depth around it.
        mask: (R, 2) edges of the mask.
        depth: (R, 2) those of the surface on it that the depth shows.
        both: (R, 2) the inner ones of both.
    """

    grid: MaskCells
    mask: Float
    depth: Float
    both: Float

    @classmethod
    def of(cls, frame: DepthFrame, mask: MaskGrid) -> MaskLayers:
        """Those of a mask."""
        grid = _grid(frame, mask)
        inside = grid.mask >= MASK_THRESHOLD
        by_mask, by_depth = _widest(inside, grid), _layer(grid, inside, frame.camera.fx)
        inner = np.fmax(by_mask[:, 0], by_depth[:, 0]), np.fmin(by_mask[:, 1], by_depth[:, 1])
        return cls(grid, by_mask, by_depth, np.stack(inner, 1))


def _grid(frame: DepthFrame, mask: MaskGrid) -> MaskCells:
    """A mask and its depth on a regular grid over its box and a little beside it."""
    x0, y0, x1, y1 = mask.box_px.tolist()
    beside_px = _BESIDE * (x1 - x0)
    (low_px, _), (high_px, _) = frame.limits_px
    x0, x1 = max(x0 - beside_px, low_px - 0.5), min(x1 + beside_px, high_px + 0.5)
    columns = int(np.clip(np.ceil(x1 - x0), 1, _COLUMNS))
    rows = int(np.clip(np.ceil(y1 - y0), 1, _ROWS))
    x_px = x0 + (np.arange(columns) + 0.5) * (x1 - x0) / columns
    y_px = y0 + (np.arange(rows) + 0.5) * (y1 - y0) / rows
    places = np.stack(np.meshgrid(x_px, y_px), -1)
    (wide, left), (high, top) = mask.to_cells
    column, row = wide * places[..., 0] + left, high * places[..., 1] + top
    probability = mask.at(column.astype(np.float32), row.astype(np.float32))
    return MaskCells(x_px, y_px, probability, frame.depth_at(places))


def _widest(inside: Bool, grid: MaskCells) -> Float:
    """(R, 2) edges in px of the widest run of cells in each row; NaN where there is none."""
    column = np.arange(inside.shape[1])
    start = np.maximum.accumulate(np.where(inside, -1, column), axis=1) + 1
    return _ends(start, np.where(inside, column - start + 1, 0), grid)


def _layer(grid: MaskCells, inside: Bool, focal_px: float) -> Float:
    """The same of the widest surface that the depth shows on the mask."""
    depth_m, column = grid.depth_m, np.arange(inside.shape[1])
    read = depth_m > 0
    before = np.maximum.accumulate(np.where(read, column, -1), axis=1)
    before = np.pad(before, ((0, 0), (1, 0)), constant_values=-1)[:, :-1]
    before_m = np.take_along_axis(depth_m, np.maximum(before, 0), 1)
    width = np.median(inside.sum(1))
    radius_m = width / 2 * grid.column_px / focal_px * depth_m
    joined = read & (before >= 0) & (np.abs(depth_m - before_m) < _MAX_STEP * radius_m)
    joined &= column - before <= 1 + _MAX_GAP * width
    start = np.maximum.accumulate(np.where(read & ~joined, column, 0), axis=1)
    on_mask = np.pad(np.cumsum(inside & read, axis=1), ((0, 0), (1, 0)))
    held: Index = on_mask[:, 1:] - np.take_along_axis(on_mask, start, 1)
    return _ends(start, np.where(read, held, 0), grid)


def _ends(start: Index, held: Index, grid: MaskCells) -> Float:
    """(R, 2) edges in px of the runs that hold the most.

    Args:
        start: (R, C) column at which the run of a cell begins.
        held: (R, C) what it holds up to this cell; 0 where there is none.
        grid: Places of the cells.
    """
    last = held.argmax(1)
    # A run that has ended with the last column would begin behind it; it holds nothing.
    first = np.minimum(np.take_along_axis(start, last[:, None], 1)[:, 0], start.shape[1] - 1)
    half_px = grid.column_px / 2
    edges_px = np.stack([grid.x_px[first] - half_px, grid.x_px[last] + half_px], 1)
    return np.where(held.max(1)[:, None] > 0, edges_px, np.nan)
