"""Cut masks of near stems to the part in which both edges are straight.

A network that sees no section of a stem, as in close pictures, often draws a mask that goes on into
the ground, plants or a root flare in front of the foot, or into places beside the stem. A stem's
own edges are two straight lines that hardly converge. So the rows of the mask are compared with two
lines, once by the edges of the mask and once by those of the layer of depth on it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from edgetree.measure.constants.outlines import MIN_BESIDE, MUCH_LONGER, NEAR_RAD, STEP_STD_PX
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame, MaskGrid
from edgetree.measure.mask_layers import NARROW, MaskCells, MaskLayers
from edgetree.measure.second_stem import mask_box
from edgetree.measure.straight_lines import MIN_ROWS, StraightPart, straight_part

# Fewer rows of a mask outside of its part tell nothing.
_MIN_LEFT = 4
# What is cut keeps its edges up to so far from the lines, in widths.
_MARGIN = 0.25


class StraightParts(NamedTuple):
    """Which of T masks are cut to their straight part.

    Attributes:
        cut: (T,) whether the mask is cut.
        above_foot: (T,) whether it ends above its lower end, so that the foot is not in it.
    """

    cut: Bool
    above_foot: Bool


def with_straight_parts(
    frame: DepthFrame, boxes_px: Float, wanted: Bool
) -> tuple[DepthFrame, Float, StraightParts]:
    """Cut the masks of a network to the straight parts of near stems.

    Args:
        frame: Depth and masks.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.
        wanted: (T,) which masks to look at: those of stems that no keypoints tell.

    Returns:
        The frame and the boxes with these masks, and which are cut.
    """
    parts = StraightParts(np.zeros_like(wanted), np.zeros_like(wanted))
    if frame.masks is None or frame.is_sparse or not frame.by_network:
        return frame, boxes_px, parts
    masks, boxes_px = list(frame.masks), boxes_px.copy()
    for index in np.flatnonzero(wanted).tolist():
        if not _is_near(masks[index], frame.camera.fx):
            continue
        found = _straight(MaskLayers.of(frame, masks[index]), masks[index])
        if found is not None:
            masks[index], parts.above_foot[index] = found
            parts.cut[index] = True
            boxes_px[index] = mask_box(masks[index], boxes_px[index])
    if parts.cut.any():
        frame = replace(frame, masks=masks)
    return frame, boxes_px, parts


def _is_near(mask: MaskGrid, focal_px: float) -> bool:
    """Whether the narrow rows of a mask are those of a near stem."""
    cells = (mask.grid >= MASK_THRESHOLD).sum(1)
    if not cells.any():
        return False
    cell_px = float(mask.box_px[2] - mask.box_px[0]) / mask.grid.shape[1]
    cells = np.sort(cells[cells > 0])
    # `np.quantile` takes much longer.
    width_px = np.interp(NARROW * (len(cells) - 1), np.arange(len(cells)), cells) * cell_px
    return bool(width_px > NEAR_RAD * focal_px)


def _straight(edges: MaskLayers, mask: MaskGrid) -> tuple[MaskGrid, bool] | None:
    """The straight part of a mask and whether it ends above the foot; None if that is all of it."""
    grid = edges.grid
    by_mask, by_depth = straight_part(edges.mask, grid), straight_part(edges.both, grid)
    if by_mask and by_depth and _mask_holds(by_mask, by_depth, grid):
        by_depth = None
    part = _of_depth(edges, by_depth) if by_depth else _of_mask(edges, by_mask)
    if part is None or part.last - part.first < MIN_ROWS:
        return None
    found = _from_edges(grid, edges.both, part) if by_depth else _shortened(mask, grid, part)
    below = np.isfinite(edges.mask[part.last :]).all(1).sum()
    return found, bool(below >= _MIN_LEFT)


def _of_depth(edges: MaskLayers, part: StraightPart) -> StraightPart:
    """A part of the depth without the rows at its foot in which the depth goes on beside it."""
    beside = _goes_on(part, edges.depth, edges.grid)
    return part._replace(last=min(part.last, len(beside) - _at_end(beside[::-1])))


def _of_mask(edges: MaskLayers, part: StraightPart | None) -> StraightPart | None:
    """All rows of a mask but those at its ends in which more than its part shows; None if none do.

    At the foot the depth tells it, too, as ground and plants there are as near as the stem.
    """
    if part is None:
        return None
    wide = _goes_on(part, edges.mask, edges.grid)
    beside = np.fmax(wide, _goes_on(part, edges.depth, edges.grid))
    top, bottom = _at_end(wide), _at_end(beside[::-1])
    if not (top or bottom):
        return None
    first = max(top, part.first) if top else 0
    last = min(len(beside) - bottom, part.last) if bottom else len(beside)
    return part._replace(first=first, last=last)


def _mask_holds(by_mask: StraightPart, by_depth: StraightPart, grid: MaskCells) -> bool:
    """Whether the part of a mask holds against that of the depth in it.

    It does if it is most of the mask. Where both are the same stem, the longer one counts. Where
    they are not, the depth's does, unless it is much shorter.
    """
    y = grid.y_px[[by_depth.first, by_depth.last - 1]]
    apart_px = np.abs((by_mask.lines - by_depth.lines) @ np.stack([np.ones(2), y]))
    width_px = np.diff(by_depth.lines @ np.stack([np.ones(2), y]), axis=0)
    same = (apart_px < MIN_BESIDE * np.maximum(width_px, grid.column_px)).all()
    longer = by_mask.gain / by_depth.gain
    most = 2 * by_mask.gain > len(grid.y_px)
    return bool(most or longer > (1.0 if same else MUCH_LONGER))


def _goes_on(part: StraightPart, edges_px: Float, grid: MaskCells) -> Float:
    """(R,) 1 where edges (R, 2) go on beside a part, -1 where they do not, and 0 without any."""
    left, right = (line[0] + line[1] * grid.y_px for line in part.lines)
    beside_px = np.fmax(left - edges_px[:, 0], edges_px[:, 1] - right)
    wide = beside_px > MIN_BESIDE * np.maximum(right - left, grid.column_px)
    return np.where(np.isfinite(beside_px), np.where(wide, 1.0, -1.0), 0.0)


def _at_end(beside: Float) -> int:
    """Rows at the beginning of (R,) of which most go on beside the stem; 0 if they are few."""
    total = np.cumsum(beside)
    rows = int(total.argmax()) + 1
    return rows if total[rows - 1] >= _MIN_LEFT else 0


def _shortened(mask: MaskGrid, grid: MaskCells, part: StraightPart) -> MaskGrid:
    """A mask in the rows of a part, and a little beside its lines."""
    rows, columns = mask.grid.shape
    x0, y0, x1, y1 = mask.box_px.tolist()
    y = y0 + (np.arange(rows) + 0.5) * (y1 - y0) / rows
    x = x0 + (np.arange(columns) + 0.5) * (x1 - x0) / columns
    half_px = grid.row_px / 2
    kept = (y > grid.y_px[part.first] - half_px) & (y < grid.y_px[part.last - 1] + half_px)
    left, right = (line[0] + line[1] * y for line in part.lines)
    margin_px = _MARGIN * (right - left)
    within = (x > (left - margin_px)[:, None]) & (x < (right + margin_px)[:, None])
    found = np.where(kept[:, None] & within, mask.grid, 0.0).astype(np.float32)
    return replace(mask, grid=found)


def _from_edges(grid: MaskCells, edges_px: Float, part: StraightPart) -> MaskGrid:
    """The rows of a part between edges (R, 2), as a mask."""
    left, right = np.nan_to_num(edges_px[part.first : part.last], nan=-1.0).T[..., None]
    covered = np.minimum(grid.x_px - left, right - grid.x_px) / grid.column_px + 0.5
    half_px = np.array([grid.column_px, grid.row_px]) / 2
    low = np.array([grid.x_px[0], grid.y_px[part.first]]) - half_px
    high = np.array([grid.x_px[-1], grid.y_px[part.last - 1]]) + half_px
    found = np.clip(covered, 0.0, 1.0).astype(np.float32)
    return MaskGrid(found, np.concatenate([low, high]), edge_std_px=STEP_STD_PX)
