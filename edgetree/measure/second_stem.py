"""Cut a second stem out of the mask of the one that is meant, or say that both may be meant."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.measure.across_mask import PARTS, AcrossMasks, look_across
from edgetree.measure.constants.depth import SIDE_BY_SIDE_RADII, SURFACE_M
from edgetree.measure.constants.outlines import FORK_WIDTH, SAME_EDGE_SHARE, STEP_STD_PX
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame, MaskGrid
from edgetree.measure.keypoints import MIDDLE, Keypoints
from edgetree.measure.outline import Outline
from edgetree.measure.regions import SearchRegions

# A second stem shows in so many parts along the stem at least, the one that is meant in so many.
_MIN_TWO, _MIN_AGREEING = 2, 3
# Where so many parts from the foot on show one stem, two above them are taken for arms of a fork.
_MIN_TRUNK = 2
# A piece of a mask between gaps, and a gap, have at least so many samples across.
_MIN_PIECE, _MIN_GAP = 3, 2
# From the lowest to the highest part, the width of a stem changes by factors between these.
_NARROWS, _WIDENS = 0.6, 1.3
# A keypoint so many standard deviations beside a stem is of another one.
_MISSED_STDS = 3.0


class SecondStems(NamedTuple):
    """Which of T masks hold a second stem.

    Attributes:
        cut: (T,) whether one is cut out of the mask.
        unclear: (T,) whether nothing tells which of them is meant.
    """

    cut: Bool
    unclear: Bool


class _Pieces(NamedTuple):
    """K pieces across the mask of a stem, each of which may be the stem in its part.

    Attributes:
        part: (K,) number of the part.
        edges_px: (K, 2) left and right edge across the search region.
        depth_m: (K,) distance of the piece; 0 where it is not known.
        inner: (K, 2) whether its left and right edge is not that of the mask.
        single: (K,) whether the part shows nothing else.
    """

    part: Index
    edges_px: Float
    depth_m: Float
    inner: Bool
    single: Bool


class _Stem(NamedTuple):
    """The stem that is meant, in P parts of its mask.

    Attributes:
        lines: (2, 2) value and slope of the lines along its left and right edge, across the
            search region by the position along it.
        inner: (P, 2) whether the left and the right edge there is not that of the mask.
        highest: Number of the highest part that it is seen in.
    """

    lines: Float
    inner: Bool
    highest: int


def without_second_stems(
    frame: DepthFrame, boxes_px: Float, outline: Outline, keypoints: Keypoints
) -> tuple[DepthFrame, Float, SecondStems]:
    """Cut second stems out of the masks of stems whose section no keypoints tell.

    If keypoints on the axis are of another stem than the nearer one, nothing tells which is meant.

    Args:
        frame: Depth, masks and settings.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.
        outline: Edges in the masks.
        keypoints: Keypoints of the stems.

    Returns:
        The frame and the boxes without them, and which masks hold one.
    """
    second = SecondStems(*np.zeros((2, len(boxes_px)), np.bool_))
    wanted = np.flatnonzero(~keypoints.has_section)
    if not len(wanted) or frame.masks is None:
        return frame, boxes_px, second
    masks, boxes_px = list(frame.masks), boxes_px.copy()
    outline = outline.of(wanted)
    across = look_across(replace(frame, masks=[masks[index] for index in wanted]), outline)
    parting = _parting(across)
    suspected = (across.two | parting).sum(1) >= _MIN_TWO
    # From its foot on, as a fork does not.
    parted = across.parted[np.arange(len(wanted)), across.seen.argmax(1)]
    parted &= across.parted.sum(1) >= _MIN_AGREEING
    for row in np.flatnonzero(suspected | parted).tolist():
        index = wanted.item(row)
        parts = AcrossMasks(*(part[row] for part in across))
        regions = outline.regions.of(np.array([row]))
        stem = _meant(parts, parting[row], regions, frame.camera.fx)
        if stem is None:
            second.unclear[index] = parted[row] or parts.two.sum() >= _MIN_TWO
            continue
        if _misses(stem, keypoints, index, regions):
            second.unclear[index] = True
            continue
        other = parts.two | parting[row]
        if stem.inner.any(1).sum() + other[stem.highest + 1 :].sum() >= _MIN_TWO:
            second.cut[index] = True
            masks[index] = _cut(masks[index], stem, regions)
            boxes_px[index] = mask_box(masks[index], boxes_px[index])
        else:
            second.unclear[index] = parted[row]
    if second.cut.any():
        frame = replace(frame, masks=masks)
    return frame, boxes_px, second


def _parting(across: AcrossMasks) -> Bool:
    """(T, P) where masks are wider than at their foot and have a gap, as above a fork."""
    count, samples = np.arange(len(across.seen)), across.filled.shape[2]
    lowest_px = across.half_px[count, across.seen.argmax(1)]
    wide = across.seen & (across.half_px > FORK_WIDTH * lowest_px[:, None])
    first = across.filled.argmax(2)
    last = samples - across.filled[..., ::-1].argmax(2)
    return np.asarray(wide & (last - first - across.filled.sum(2) >= _MIN_GAP))


def _meant(
    parts: AcrossMasks, parting: Bool, regions: SearchRegions, focal_px: float
) -> _Stem | None:
    """The stem that is meant: the nearer one, or that below a fork; None if two may be.

    Its edges and its distance are straight lines along it, through two pieces. The best lines are
    those that agree with pieces in the most parts. They begin at its foot, or where plants hide
    that, they join parts that show one stem. Arms of a fork may go on where its trunk ends, so the
    stem ends there.

    Args:
        parts: What shows across its mask, (P, ...) arrays.
        parting: (P,) where the mask parts above a fork.
        regions: The search region of this stem.
        focal_px: Focal length.
    """
    position = regions.stations_px.reshape(PARTS, -1).mean(1)
    pieces = _pieces(parts, parting)
    part, foot = pieces.part, np.isin(pieces.part, np.unique(pieces.part)[:2])
    first, second = np.nonzero(part[:, None] < part)
    kept = foot[first] | (pieces.single[first] & pieces.single[second])
    first, second = first[kept], second[kept]
    if not len(first):
        return None
    agrees, off = _agreeing(pieces, position[part], first, second, focal_px)
    agrees &= foot[first][:, None] | pieces.single
    inside = np.stack([(agrees & (part == each)).any(1) for each in range(PARTS)], 1)
    number = inside.sum(1) + inside[:, part.min()]
    own = agrees[int((number - off).argmax())]
    other = part[~pieces.single]
    trunk = part < (other.min() if len(other) else 0)
    if (own & ~pieces.single).any():
        if len(np.unique(part[trunk])) >= _MIN_TRUNK:
            own = trunk
        elif not own[part == part.min()].any() or len(np.unique(part[own])) < _MIN_AGREEING:
            return None
    return _through(pieces, own, parts, position)


def _agreeing(
    pieces: _Pieces, position: Float, first: Index, second: Index, focal_px: float
) -> tuple[Bool, Float]:
    """Compare K pieces with the lines through L pairs of them.

    Args:
        pieces: The pieces.
        position: (K,) their places along the stem.
        first, second: (L,) numbers of the pieces of each pair.
        focal_px: Focal length.

    Returns:
        (L, K) which pieces lie on the lines, and (L,) how far they are off, in widths of the stem.
    """
    values = np.column_stack([pieces.edges_px, pieces.depth_m])
    slope = (values[second] - values[first]) / (position[second] - position[first])[:, None]
    along = (position - position[first, None])[..., None]
    left, right, depth_m = np.moveaxis(values[first, None] + slope[:, None] * along, 2, 0)
    width = np.maximum(right - left, 1e-9)
    off_px = np.maximum(np.abs(values[:, 0] - left), np.abs(values[:, 1] - right))
    off_m = np.where(values[:, 2] > 0, np.abs(values[:, 2] - depth_m), 0.0)
    within_m = width / 2 * np.maximum(depth_m, 0.0) / focal_px + SURFACE_M
    agrees = (off_px < SAME_EDGE_SHARE * width + 1) & (off_m < within_m)
    change = width[:, position.argmax()] / width[:, position.argmin()]
    plausible = (right > left).all(1) & (change > _NARROWS) & (change < _WIDENS)
    agrees &= plausible[:, None]
    return agrees, np.where(agrees, off_px / width, 0.0).mean(1)


def _through(pieces: _Pieces, own: Bool, parts: AcrossMasks, position: Float) -> _Stem | None:
    """The stem of its `own` (K,) pieces; None if another is beside it at its foot."""
    part = pieces.part[own]
    if len(np.unique(part)) < 2:
        return None
    lowest = int(part.min())
    if parts.two[lowest] and parts.behind[lowest] < SIDE_BY_SIDE_RADII:
        return None
    inner = np.zeros((PARTS, 2), np.bool_)
    inner[part] = pieces.inner[own]
    slope, value = np.polyfit(position[part], pieces.edges_px[own], 1)
    return _Stem(np.column_stack([value, slope]), inner, int(part.max()))


def _misses(stem: _Stem, keypoints: Keypoints, index: int, regions: SearchRegions) -> bool:
    """Whether a keypoint on the axis is outside of the lines along a stem."""
    shown = keypoints.within[index, MIDDLE:]
    from_px = keypoints.xy_px[index, MIDDLE:][shown] - regions.origin_px[0]
    along, across = from_px @ regions.along[0], from_px @ regions.across[0]
    left, right = (value + slope * along for value, slope in stem.lines)
    off_px = np.maximum(left - across, across - right)
    std_px = keypoints.std_px[index, MIDDLE:, 0][shown]
    return bool((off_px > _MISSED_STDS * std_px).any())


def _pieces(parts: AcrossMasks, parting: Bool) -> _Pieces:
    """The pieces of a mask: the nearer of two stems, those between gaps above a fork, or all of it.

    Args:
        parts: What shows across the mask, (P, ...) arrays.
        parting: (P,) where it parts above a fork.
    """
    samples = parts.filled.shape[1]
    found = []
    for number in np.flatnonzero(parts.seen).tolist():
        ends = [0, samples]
        if parting[number]:
            ends = np.flatnonzero(
                np.diff(parts.filled[number], prepend=False, append=False)
            ).tolist()
        near_low, near_high = ((parts.near[number] + 1) * samples / 2).tolist()
        for low, high in zip(ends[::2], ends[1::2], strict=True):
            start, end = max(low, near_low), min(high, near_high)
            if end - start >= _MIN_PIECE:
                known = parts.depth_m[number, round(start) : round(end)]
                depth_m = float(np.median(known[known > 0])) if (known > 0).any() else 0.0
                single = not (parts.two[number] or parting[number])
                found.append((number, start, end, depth_m, start > 0, end < samples, single))
    values = np.array(found, np.float64).reshape(-1, 7)
    part = values[:, 0].astype(np.intp)
    places = values[:, 1:3] * 2 / samples - 1
    edges_px = parts.middle_px[part, None] + parts.half_px[part, None] * places
    return _Pieces(part, edges_px, values[:, 3], values[:, 4:6] > 0, values[:, 6] > 0)


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
    left, right = (value + slope * along for value, slope in stem.lines)
    margin = np.where(stem.inner[part], 0.0, 0.25 * (right - left)[..., None])
    inside_px = np.minimum(across - left + margin[..., 0], right - across + margin[..., 1])
    kept = np.clip(0.5 + inside_px / max(mask.cell_px, 1e-6), 0.0, 1.0)
    kept[part > stem.highest] = 0.0
    return replace(
        mask,
        grid=np.minimum(mask.grid, kept.astype(np.float32)),
        edge_std_px=STEP_STD_PX,
        whole=mask,
    )


def mask_box(mask: MaskGrid, box_px: Float) -> Float:
    """(4,) box around what is left of a mask."""
    inside = mask.grid >= MASK_THRESHOLD
    rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    if not len(rows):
        return box_px
    cell = (mask.box_px[2:] - mask.box_px[:2]) / inside.shape[::-1]
    low = mask.box_px[:2] + np.array([columns[0], rows[0]]) * cell
    return np.concatenate([low, mask.box_px[:2] + np.array([columns[-1] + 1, rows[-1] + 1]) * cell])
