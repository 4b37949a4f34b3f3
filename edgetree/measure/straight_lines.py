"""Find the part of a mask in which both edges are straight lines that hardly converge."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.measure.constants.outlines import (
    EDGE_TOLERANCE,
    MAX_CONVERGENCE,
    MIN_EDGE_TOLERANCE_PX,
)
from edgetree.measure.mask_layers import NARROW, MaskCells
from edgetree.measure.search_regions import MIN_ASPECT

# A part has so many rows at least, and edges in this share of them.
MIN_ROWS, _MIN_FILLED = 12, 0.6
# Lines are laid through runs of so many rows, which begin at every second row. A row tells against
# a part as much as so many tell for it, and less where it shows no edges.
_RUNS, _EVERY, _MOST_OFF, _UNKNOWN, _REFITS = (10, 20, 40, 80), 2, 1.0, 0.3, 3


class StraightPart(NamedTuple):
    """The straight part of some edges by row.

    Attributes:
        first, last: Its first row, and the one after its last.
        lines: (2, 2) value and slope of the left and right line by y.
        gain: How many rows more it explains than it contradicts, less where it is short for its
            width.
    """

    first: int
    last: int
    lines: Float
    gain: float


def straight_part(edges_px: Float, grid: MaskCells) -> StraightPart | None:
    """The straight part of edges (R, 2), or None.

    Each row counts 1 less the mean square of its distances from two lines, in tolerances, and
    -`_MOST_OFF` at least, as stubs and notches are part of a stem. The part is the run of rows with
    the largest sum, by the best of all lines through short runs of rows.
    """
    # The ends of the grid, which are often those of the picture, are no edges.
    low_px, high_px = grid.x_px[0], grid.x_px[-1]
    known = (edges_px[:, 0] > low_px) & (edges_px[:, 1] < high_px)
    if known.sum() < MIN_ROWS:
        return None
    half_px = float(np.quantile(np.diff(edges_px[known], axis=1), NARROW)) / 2
    tolerance_px = max(EDGE_TOLERANCE * half_px, MIN_EDGE_TOLERANCE_PX, grid.column_px)
    lines = _lines_through_runs(edges_px, known, grid)
    shown = np.asarray(np.isfinite(edges_px).all(1))
    if not len(lines):
        return None
    for _ in range(_REFITS):
        scores = _scores(lines, edges_px, shown, grid, tolerance_px)
        first, last, gain = _best_run(scores)
        gain *= _elongation(lines, first, last, grid)
        best = int(gain.argmax())
        if not gain[best] >= MIN_ROWS * _MIN_FILLED / 2:
            return None
        rows = np.flatnonzero((scores[best] > 0) & known)
        rows = rows[(rows >= first[best]) & (rows <= last[best])]
        part = StraightPart(int(first[best]), int(last[best]) + 1, lines[best], float(gain[best]))
        lines = np.concatenate([lines[[best]], _fitted(edges_px[rows], grid.y_px[rows])[None]])
    return part


def _elongation(lines: Float, first: Index, last: Index, grid: MaskCells) -> Float:
    """(L,) how far runs of rows are as long for their width as a stem is, at most 1."""
    middle_px = (grid.y_px[first] + grid.y_px[last]) / 2
    width_px = np.diff(lines[..., 0] + lines[..., 1] * middle_px[:, None], axis=1)[:, 0]
    length_px = (last - first + 1) * grid.row_px
    return np.clip(length_px / np.maximum(width_px, grid.column_px) / MIN_ASPECT, 0.0, 1.0)


def _lines_through_runs(edges_px: Float, known: Bool, grid: MaskCells) -> Float:
    """(L, 2, 2) lines through the edges of short and long runs of rows."""
    total = [
        np.pad(np.cumsum(np.where(known[:, None], each, 0.0), axis=0), ((1, 0), (0, 0)))
        for each in _moments(edges_px, grid.y_px)
    ]
    rows = len(grid.y_px)
    starts = [
        (np.arange(0, rows - length + 1, _EVERY), length) for length in _RUNS if length <= rows
    ]
    first = np.concatenate([start for start, _ in starts])
    last = np.concatenate([start + length for start, length in starts])
    lines = _line(*(each[last] - each[first] for each in total))
    converging = np.abs(lines[:, 1, 1] - lines[:, 0, 1])
    return lines[np.isfinite(lines).all((1, 2)) & (converging < MAX_CONVERGENCE)]


def _moments(edges_px: Float, y_px: Float) -> tuple[Float, ...]:
    """Summands (R, 2) of straight lines through edges (R, 2)."""
    y = np.repeat(y_px[:, None], 2, 1)
    return np.ones_like(y), y, y**2, edges_px, edges_px * y


def _line(number: Float, y: Float, yy: Float, x: Float, xy: Float) -> Float:
    """(..., 2, 2) value and slope of lines by sums (..., 2); not finite without two rows."""
    slope = (number * xy - x * y) / (number * yy - y**2)
    return np.stack([(x - slope * y) / number, slope], -1)


def _fitted(edges_px: Float, y_px: Float) -> Float:
    """(2, 2) lines through edges (K, 2)."""
    return _line(*(each.sum(0) for each in _moments(edges_px, y_px)))


def _scores(
    lines: Float, edges_px: Float, known: Bool, grid: MaskCells, tolerance_px: float
) -> Float:
    """(L, R) what each row tells for each pair of lines (L, 2, 2)."""
    line_px = lines[:, None, :, 0] + lines[:, None, :, 1] * grid.y_px[:, None]
    off = np.where(known[:, None], edges_px - line_px, 0.0) / tolerance_px
    told = np.maximum(1 - (off**2).mean(2), -_MOST_OFF)
    return np.where(known, told, -_UNKNOWN)


def _best_run(scores: Float) -> tuple[Index, Index, Float]:
    """(L,) first and last row of the runs with the largest sums of scores (L, R), and these."""
    total = np.pad(np.cumsum(scores, axis=1), ((0, 0), (1, 0)))
    lowest = np.minimum.accumulate(total, axis=1)[:, :-1]
    gain = total[:, 1:] - lowest
    last = gain.argmax(1)
    before = np.arange(scores.shape[1])[None] <= last[:, None]
    first = np.where(before, total[:, :-1], np.inf).argmin(1)
    return first, last, gain.max(1)
