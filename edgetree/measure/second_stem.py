"""Cut a second stem out of the mask of the one that is meant, or say that none is told from it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from edgetree.measure.across_mask import PARTS, AcrossMasks, look_across
from edgetree.measure.constants.outlines import FORK_WIDTH, SAME_EDGE_SHARE, STEP_STD_PX
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame, MaskGrid
from edgetree.measure.outline import Outline
from edgetree.measure.regions import SearchRegions

# A second stem shows in at least so many parts along the stem, and the one that is meant in so many.
_MIN_TWO, _MIN_AGREEING = 2, 2
# A piece of a mask between gaps, and a gap, have at least so many samples across.
_MIN_PIECE, _MIN_GAP = 3, 2
# The width of a stem changes along its mask by these factors.
_NARROWS, _WIDENS = 0.4, 1.3


class SecondStems(NamedTuple):
    """Which of T masks hold a second stem.

    Attributes:
        cut: (T,) whether one is cut out of the mask.
        unclear: (T,) whether nothing tells which of them is meant.
    """

    cut: Bool
    unclear: Bool


class _Stem(NamedTuple):
    """The stem that is meant, in P parts of its mask.

    Attributes:
        edges_px: (2, 2) value and slope of the lines along its left and right edge, across the
            search region by the position along it.
        agreeing: (P,) parts in which these are its edges.
        steps: (P, 2) whether the left and the right edge there is that to the other stem.
    """

    edges_px: Float
    agreeing: Bool
    steps: Bool


def without_second_stems(
    frame: DepthFrame, boxes_px: Float, outline: Outline, wanted: Bool
) -> tuple[DepthFrame, Float, SecondStems]:
    """Cut second stems out of the masks.

    Args:
        frame: Depth, masks and settings.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.
        outline: Edges in the masks.
        wanted: (T,) which masks to look at: those of stems that no keypoints tell.

    Returns:
        The frame and the boxes without them, and which masks hold one.
    """
    none = SecondStems(np.zeros(len(wanted), np.bool_), np.zeros(len(wanted), np.bool_))
    if not wanted.any() or frame.masks is None:
        return frame, boxes_px, none
    across = look_across(frame, outline)
    masks, boxes_px = list(frame.masks), boxes_px.copy()
    for index in np.flatnonzero(wanted & _suspected(across)).tolist():
        parts = AcrossMasks(*(part[index] for part in across))
        regions = SearchRegions(*(part[[index]] for part in outline.regions.arrays))
        stem = _meant(parts, regions)
        none.unclear[index], none.cut[index] = stem is None, stem is not None
        if stem is not None:
            masks[index] = _cut(masks[index], stem, regions)
            boxes_px[index] = _box(masks[index], boxes_px[index])
    return replace(frame, masks=masks), boxes_px, none


def _suspected(across: AcrossMasks) -> Bool:
    """(T,) whether masks may hold two stems: by the depth, or as they part above a fork."""
    count = np.arange(len(across.seen))
    lowest = across.half_px[count, across.seen.argmax(1)]
    wide = across.seen & (across.half_px > FORK_WIDTH * lowest[:, None])
    first = across.filled.argmax(2)[..., None]
    last = across.filled.shape[2] - 1 - across.filled[..., ::-1].argmax(2)[..., None]
    place = np.arange(across.filled.shape[2])
    gaps = (~across.filled & (place > first) & (place < last)).sum(2) >= _MIN_GAP
    return np.asarray((across.two | (wide & gaps)).sum(1) >= _MIN_TWO)


def _meant(parts: AcrossMasks, regions: SearchRegions) -> _Stem | None:
    """The stem that is meant: the nearer one, or that below a fork; None if two may be.

    Pieces of the mask in two of its parts give straight lines along both edges. The best lines
    are those of the most parts, from the foot on.
    """
    position = regions.stations_px.reshape(PARTS, -1).mean(1)
    part, pieces, steps = _pieces(parts)
    if not len(part):
        return None
    edges_px = parts.middle_px[part, None] + parts.half_px[part, None] * pieces
    first, second = np.nonzero(part[:, None] < part)
    gaps = np.array([(~parts.filled[each]).any() for each in range(PARTS)])
    single = ~(parts.two | gaps)[part]
    foot = np.isin(part, np.unique(part)[:2])
    kept = foot[first] | (single[first] & single[second])
    first, second = first[kept], second[kept]
    slope = (edges_px[second] - edges_px[first]) / (position[part[second]] - position[part[first]])[
        :, None
    ]
    value = edges_px[first] - slope * position[part[first], None]
    lines = value[:, None] + slope[:, None] * position[:, None]
    width = lines[..., 1] - lines[..., 0]
    change = width[:, -1] / np.maximum(width[:, 0], 1e-9)
    plausible = (width > 0).all(1) & (change > _NARROWS) & (change < _WIDENS)
    off = np.abs(edges_px - lines[:, part]).max(2)
    agrees = off < SAME_EDGE_SHARE * width[:, part] + 1
    # Without the foot, as where plants hide it, only parts with one stem tell.
    agrees &= foot[first][:, None] | single
    agreeing = np.stack([(agrees & (part == each)).any(1) for each in range(PARTS)], 1)
    score = np.where(
        plausible,
        agreeing.sum(1)
        - np.where(agrees, off, 0).sum(1) / (1 + np.where(agrees, width[:, part], 0).sum(1)),
        0,
    )
    if not len(score) or score.max() <= _MIN_AGREEING - 1:
        return None
    best = int(score.argmax())
    own = agrees[best]
    own_steps = np.zeros((PARTS, 2), np.bool_)
    own_steps[part[own]] = steps[own]
    lines_fit = np.array(
        [np.polyfit(position[part[own]], edges_px[own, side], 1)[::-1] for side in (0, 1)]
    )
    # Two at the same distance.
    lowest = int(part[own].min())
    same = parts.two[lowest] and parts.behind[lowest] < 1
    if same:
        return None
    return _Stem(lines_fit, agreeing[best], own_steps)


def _pieces(parts: AcrossMasks) -> tuple[Float, Float, Bool]:
    """Pieces (K,) parts, (K, 2) edges in half widths, (K, 2) whether these are steps."""
    found = []
    samples = parts.filled.shape[1]
    for part in np.flatnonzero(parts.seen).tolist():
        change = np.diff(np.concatenate([[0], parts.filled[part].astype(int), [0]]))
        runs = np.stack([np.flatnonzero(change > 0), np.flatnonzero(change < 0)], 1)
        whole = [
            (2 * low / samples - 1, 2 * high / samples - 1)
            for low, high in runs
            if high - low >= _MIN_PIECE
        ]
        if len(whole) > 1 and not parts.two[part]:
            whole.append((-1.0, 1.0))
        for low, high in whole:
            near_low, near_high = np.clip([low, high], *parts.near[part])
            if near_high - near_low >= 2 * _MIN_PIECE / samples:
                found.append((part, near_low, near_high, near_low > -1, near_high < 1))
    if not found:
        return np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2), bool)
    values = np.array(found)
    return values[:, 0].astype(np.intp), values[:, 1:3], values[:, 3:] > 0


def _cut(mask: MaskGrid, stem: _Stem, regions: SearchRegions) -> MaskGrid:
    """The part of a mask that is of one stem.

    It ends at the line along the other stem where that shows, and a little beyond the lines in
    other parts. Above the highest part that agrees with the lines it ends.
    """
    rows, columns = mask.grid.shape
    x0, y0, x1, y1 = mask.box_px.tolist()
    x = x0 + (np.arange(columns) + 0.5) * (x1 - x0) / columns - regions.origin_px[0, 0]
    y = y0 + (np.arange(rows)[:, None] + 0.5) * (y1 - y0) / rows - regions.origin_px[0, 1]
    along = x * regions.along[0, 0] + y * regions.along[0, 1]
    across = x * regions.across[0, 0] + y * regions.across[0, 1]
    low, high = regions.span_px[0]
    part = np.clip(((along - low) / (high - low) * PARTS).astype(np.intp), 0, PARTS - 1)
    left, right = (value + slope * along for value, slope in stem.edges_px)
    margin = np.where(stem.steps[part], 0.0, 0.25 * (right - left)[..., None])
    inside_px = np.minimum(across - left + margin[..., 0], right - across + margin[..., 1])
    kept = np.clip(0.5 + inside_px / max(mask.cell_px, 1e-6), 0.0, 1.0)
    highest = int(np.flatnonzero(stem.agreeing).max())
    kept[part > highest] = 0.0
    return replace(
        mask,
        grid=np.minimum(mask.grid, kept.astype(np.float32)),
        edge_std_px=STEP_STD_PX,
        whole=mask,
    )


def _box(mask: MaskGrid, box_px: Float) -> Float:
    """(4,) box around what is left of a mask."""
    inside = mask.grid >= MASK_THRESHOLD
    rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    if not len(rows):
        return box_px
    cell = (mask.box_px[2:] - mask.box_px[:2]) / inside.shape[::-1]
    low = mask.box_px[:2] + np.array([columns[0], rows[0]]) * cell
    return np.concatenate([low, mask.box_px[:2] + np.array([columns[-1] + 1, rows[-1] + 1]) * cell])
