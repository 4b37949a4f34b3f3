"""Where to search for the edges of stems: along their keypoints, or along their masks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from basetree.arrays import Float
from calib.directions import lengths
from edgetree.measure.edge_lines import outer_lines
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame, MaskGrid
from edgetree.measure.keypoints import LEFT, MIDDLE, MIN_WIDTH_PX, RIGHT, TOP, Keypoints
from edgetree.measure.mask_edges import COARSE_STEP, coarse_edges, realigned
from edgetree.measure.regions import MIN_HALF_PX, STATIONS, SearchRegions, line_spans

# Realignments of a region from each start.
_REALIGNMENTS = 2
# If a smaller share of the edges of a short mask lies on straight lines, only its rows with smooth
# edges are searched. Edges closer to the border of the image than a coarse step do not count.
_MIN_AGREEING = 0.5
# Neighbouring rows of a mask belong together if their edges differ by less than this share of
# their width, or this many cells. So many rows, and so many per width, make a stem.
_MAX_JUMP, _MAX_JUMP_CELLS = 0.05, 2.0
_MIN_ROWS, _MIN_ROWS_PER_WIDTH = 8, 0.3

MIN_ASPECT = 2.2
"""Aspect ratio of a mask below which the direction from its moments is not trusted alone."""


def find_regions(frame: DepthFrame, boxes_px: Float, keypoints: Keypoints) -> SearchRegions:
    """Regions around the stems, from keypoints, or from masks where the section has none.

    The centre line starts in the middle of the section. It points to the keypoints further up, or
    is at right angles to the section if they are too close to it.

    Args:
        frame: The frame, with its masks if there are any.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.
        keypoints: Keypoints of the same trees.
    """
    left, right = keypoints.xy_px[:, LEFT], keypoints.xy_px[:, RIGHT]
    origin = (left + right) / 2
    half = np.maximum(lengths(right - left) / 2, MIN_WIDTH_PX / 2)
    upwards = np.zeros_like(origin)
    for keypoint in (MIDDLE, TOP):
        upwards += keypoints.given[:, keypoint, None] * (keypoints.xy_px[:, keypoint] - origin)
    side = (right - left) * np.where(right[:, :1] < left[:, :1], -1.0, 1.0)
    perpendicular = np.stack([side[:, 1], -side[:, 0]], -1)
    known = lengths(upwards) > 2 * half
    along = np.where(known[:, None], upwards, perpendicular)
    without = ~keypoints.has_section
    limit = np.full((len(origin), 2), np.inf) * (-1.0, 1.0)
    if without.any() and frame.masks is not None:
        indices = np.flatnonzero(without)
        few = replace(frame, masks=[frame.masks[index] for index in indices])
        found = _regions_from_masks(few, boxes_px[indices])
        origin[indices], along[indices] = found.origin_px, found.along
        half[indices], limit[indices] = found.half_px, found.span_px
    length = lengths(along)[:, None]
    along = np.where(length > 0, along / np.where(length > 0, length, 1.0), np.array([0.0, -1.0]))
    span = line_spans(origin, along, boxes_px)
    span = np.stack([np.maximum(span[:, 0], limit[:, 0]), np.minimum(span[:, 1], limit[:, 1])], -1)
    return SearchRegions(origin, along, half, span)


def _regions_from_masks(frame: DepthFrame, boxes_px: Float) -> SearchRegions:
    """Search regions of stems that have masks but no keypoints at their section.

    The direction comes from the image moments of each mask. If the mask is short for its width,
    as of a near stem that the image cuts off, the moments may point askew. Then the vertical of
    the image is tried as well, and the direction with more edges on straight lines wins. If few
    edges lie on straight lines either way, the region is that of the mask's clean rows.

    Args:
        frame: The frame, with one mask per stem.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.
    """
    masks = frame.masks or []
    origin, along, half, short = (
        np.stack(part) for part in zip(*map(_moments, masks), strict=True)
    )
    span = line_spans(origin, along, boxes_px)
    for index in np.flatnonzero(short):
        single = replace(frame, masks=[masks[index]])
        start, box = origin[index, None], boxes_px[index, None]
        vertical = np.array([[0.0, -1.0]])
        candidates = [
            _repeatedly_realigned(
                single,
                SearchRegions(
                    start, direction, half[index, None], line_spans(start, direction, box)
                ),
            )
            for direction in (along[index, None], vertical)
        ]
        best, agreeing = max(candidates, key=lambda pair: pair[1])
        best = replace(best, span_px=line_spans(best.origin_px, best.along, box))
        clean = _clean_rows(masks[index], frame.camera.width)
        if clean is not None and agreeing < _MIN_AGREEING * 2 * STATIONS:
            best = clean
        for target, source in zip((origin, along, half, span), best.arrays, strict=True):
            target[index] = source[0]
    return SearchRegions(origin, along, half, span)


def _repeatedly_realigned(frame: DepthFrame, regions: SearchRegions) -> tuple[SearchRegions, int]:
    """Align a region with its mask's edges; also return how many edges lay on straight lines."""
    for _ in range(_REALIGNMENTS):
        edges_px, seen = coarse_edges(frame, regions)
        straight = outer_lines(regions, edges_px, seen).agreeing
        border_px = COARSE_STEP * regions.half_px[:, None, None]
        within = frame.inside(regions.points(edges_px[..., None]), border_px)[..., 0]
        agreeing = int((straight & within).sum())
        regions = realigned(regions, edges_px, seen)
    return regions, agreeing


def _moments(mask: MaskGrid) -> tuple[Float, Float, Float, np.bool_]:
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
    short = np.bool_(variances[1] < MIN_ASPECT**2 * variances[0])
    return np.array([mean_x, mean_y]), along, np.asarray(max(half, MIN_HALF_PX)), short


def _clean_rows(mask: MaskGrid, width_px: int) -> SearchRegions | None:
    """Region of the longest run of rows in which a mask has two smooth edges.

    For masks that show much else beside the stem in their other rows.

    Args:
        mask: The mask.
        width_px: Width of the image; rows that reach its border are not clean.

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
