"""Find the left and right edges of stems in their masks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.depth_edges import find_depth_edges, front_depth_m
from edgetree.measure.edge_lines import OuterLines, fit_lines, outer_lines
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.regions import (
    MIN_HALF_PX,
    STATIONS,
    SearchRegions,
    clean_rows,
    line_spans,
    mask_moments,
)

__all__ = ["Outline", "regions_from_masks", "trace_outline"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

# Edges are searched for across this many half widths, with this many samples. A second search
# around each edge found takes more samples over this part of the half width, or at least px.
_SEARCH_HALF_WIDTHS = 1.8
_COARSE_SAMPLES, _FINE_SAMPLES = 25, 13
_FINE_REACH, _MIN_FINE_REACH_PX = 0.12, 1.5
# Direction across the region in which each edge faces away from the stem.
_OUTWARDS = np.array([-1.0, 1.0])[:, None, None]
# With fewer stations than this a search region is not realigned.
_MIN_STATIONS = 6
# Share of the edges that must contradict a line; fewer are the rounded foot of a stem.
_MIN_CONTRADICTING = 0.2
# Realignments of a region from each start.
_REALIGNMENTS = 2
# If a smaller fraction of the edges of a short mask lies on straight lines, only its rows with
# smooth edges are searched.
_MIN_AGREEING = 0.5
# Edges closer than this to the border of the image do not count then, in half widths: the distance
# of the samples of a coarse search.
_BORDER = 2 * _SEARCH_HALF_WIDTHS / (_COARSE_SAMPLES - 1)


@dataclass(frozen=True, eq=False)
class Outline:
    """The edges of T stems in their masks, at S stations.

    Attributes:
        regions: search regions.
        left_px, right_px: (T, S) positions of the edges across the region.
        left_valid, right_valid: (T, S) whether these are edges of the stem itself.
        visible_fraction: (T,) fraction of the stations at which the mask shows both sides.
        std_px: (T,) standard deviation of an edge.
    """

    regions: SearchRegions
    left_px: Float
    right_px: Float
    left_valid: Flags
    right_valid: Flags
    visible_fraction: Float
    std_px: Float

    @property
    def scatter_px(self) -> Float:
        """(T,) root mean square distance of the valid edges from straight lines along them."""
        position = self.regions.stations_px
        squares, count = np.zeros(len(position)), np.zeros(len(position))
        for edge_px, valid in (
            (self.left_px, self.left_valid),
            (self.right_px, self.right_valid),
        ):
            edge_px = np.where(valid, edge_px, 0.0)
            value, slope = fit_lines(position, edge_px, valid.astype(np.float64))
            residual = edge_px - value[:, None] - slope[:, None] * position
            squares += np.where(valid, residual**2, 0.0).sum(1)
            count += np.maximum(valid.sum(1) - 2, 0)
        return np.asarray(np.sqrt(squares / np.maximum(count, 1)))


def regions_from_masks(frame: DepthFrame, boxes_px: Float) -> SearchRegions:
    """Search regions of stems that have masks but no keypoints at their section.

    The direction comes from the image moments of each mask. If the mask is short for its width,
    as of a near stem that the image cuts off, the moments may point askew. Then the vertical of
    the image is tried as well, and the direction with more edges on straight lines wins. If few
    edges lie on straight lines either way, the region is that of the mask's clean rows.

    Args:
        frame: the frame, with one mask per stem.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.
    """
    masks = frame.masks or []
    origin, along, half, short = (
        np.stack(part) for part in zip(*map(mask_moments, masks), strict=True)
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
        clean = clean_rows(masks[index], frame.camera.width)
        if clean is not None and agreeing < _MIN_AGREEING * 2 * STATIONS:
            best = clean
        for target, source in zip((origin, along, half, span), best.arrays, strict=True):
            target[index] = source[0]
    return SearchRegions(origin, along, half, span)


def _repeatedly_realigned(frame: DepthFrame, regions: SearchRegions) -> tuple[SearchRegions, int]:
    """Align a region with its mask's edges; also return how many edges lay on straight lines."""
    for _ in range(_REALIGNMENTS):
        left, right, seen = _coarse_edges(frame, regions)
        straight = outer_lines(regions, left, right, np.stack([seen] * 2)).agreeing
        border_px = _BORDER * regions.half_px[:, None, None]
        within = frame.inside(regions.points(np.stack([left, right], -1)), border_px)
        agreeing = int((straight & within.transpose(2, 0, 1)).sum())
        regions = _realigned(regions, left, right, seen)
    return regions, agreeing


def trace_outline(frame: DepthFrame, regions: SearchRegions, border_px: Float) -> Outline:
    """Find both edges of every stem at every station.

    A coarse search first aligns the search regions with the masks, then a fine search locates the
    edges. Where the depth shows that a stem's surface ends inside its mask, the edges are moved
    there. Edges that contradict the depth or each other have a larger standard deviation.

    Args:
        frame: the frame, with one mask per stem.
        regions: where to search.
        border_px: (T, 2) left and right edges closer than this to the border of the image are not
            valid, since there the image ends and not the stem.
    """
    regions = _realigned(regions, *_coarse_edges(frame, regions))
    left, right, seen = _coarse_edges(frame, regions)
    left, right, found = _fine_edges(frame, regions, left, right, border_px)
    edges_px, std_px = np.stack([left, right]), frame.mask_std_px()
    found &= seen
    depth = find_depth_edges(frame, regions, edges_px, found, front_depth_m(frame, regions))
    # Missing readings alone may be a fault of the depth, so they do not move the edges.
    moves = (depth.median_px > 0) & (depth.behind.sum(2) >= 0.5 * depth.known.sum(2))
    found = np.where(moves[..., None], depth.known, found)
    edges_px -= _OUTWARDS * np.where(moves[..., None] & depth.known, depth.inset_px, 0.0)
    lines = outer_lines(regions, edges_px[0], edges_px[1], found, depth.behind)
    inside_px = np.where(moves, 0.0, depth.median_px)
    contradiction_px = _contradiction_px(regions, lines, edges_px, found, depth.known)
    std_px = np.hypot(std_px, np.hypot(inside_px, contradiction_px).max(0))
    left_valid, right_valid = lines.agreeing
    left, right = edges_px
    return Outline(regions, left, right, left_valid, right_valid, seen.mean(1), std_px)


def _contradiction_px(
    regions: SearchRegions, lines: OuterLines, edges_px: Float, found: Flags, ends: Flags
) -> Float:
    """(2, T) root mean square distance by which edges where the stem ends lie inside the lines."""
    line_px = lines.value[..., None] + lines.slope[..., None] * regions.stations_px
    inside_px = np.maximum(line_px - _OUTWARDS * edges_px, 0.0)
    contradicts = ends & found & ~lines.agreeing & (inside_px > 0)
    count = np.maximum(found.sum(2), 1)
    many = contradicts.sum(2) >= _MIN_CONTRADICTING * count
    squares = np.where(contradicts, inside_px**2, 0.0).sum(2)
    return np.where(many, np.sqrt(squares / count), 0.0)


def _coarse_edges(frame: DepthFrame, regions: SearchRegions) -> tuple[Float, Float, Flags]:
    """(T, S) left and right edges in px across the regions, and where both were found."""
    across = np.linspace(-_SEARCH_HALF_WIDTHS, _SEARCH_HALF_WIDTHS, _COARSE_SAMPLES)
    across = across * regions.half_px[:, None, None]
    across = np.broadcast_to(across, (len(regions.half_px), STATIONS, _COARSE_SAMPLES))
    probability = frame.mask_probability(regions.points(across))
    left, left_seen = _first_crossing(probability, across)
    right, right_seen = _first_crossing(probability[..., ::-1], across[..., ::-1])
    return left, right, left_seen & right_seen


def _fine_edges(
    frame: DepthFrame, regions: SearchRegions, left: Float, right: Float, border_px: Float
) -> tuple[Float, Float, Flags]:
    """Refine (T, S) edges; also return (2, T, S) where a left and a right edge was found."""
    reach = np.maximum(_FINE_REACH * regions.half_px, _MIN_FINE_REACH_PX)[:, None, None]
    steps = np.linspace(-1.0, 1.0, _FINE_SAMPLES) * reach
    across = np.stack([left[..., None] + steps, right[..., None] - steps], 2)
    probability = frame.mask_probability(regions.points(across.reshape(*left.shape, -1)))
    found, seen = _first_crossing(probability.reshape(across.shape), across)
    seen = seen & frame.inside(regions.points(found), border_px[:, None])
    return found[..., 0], found[..., 1], seen.transpose(2, 0, 1)


def _first_crossing(probability: Float, across: Float) -> tuple[Float, Flags]:
    """First position at which a mask rises above the threshold, linearly interpolated.

    Args:
        probability: (..., C) samples of the mask.
        across: (..., C) their positions.

    Returns:
        (...) positions, and (...) whether there is such a crossing.
    """
    inside = probability >= MASK_THRESHOLD
    first = np.maximum(inside.argmax(-1), 1)[..., None]
    high, low = (np.take_along_axis(probability, at, -1)[..., 0] for at in (first, first - 1))
    end, start = (np.take_along_axis(across, at, -1)[..., 0] for at in (first, first - 1))
    rise = np.where(high > low, high - low, 1.0)
    crossing = start + (end - start) * (MASK_THRESHOLD - low) / rise
    return crossing, inside.any(-1) & ~inside[..., 0]


def _realigned(regions: SearchRegions, left: Float, right: Float, seen: Flags) -> SearchRegions:
    """Move and turn the regions to lie midway between the lines along both edges."""
    enough = seen.sum(1) >= _MIN_STATIONS
    sides = outer_lines(regions, left, right, np.stack([seen, seen]))
    value = np.where(enough, (sides.value[1] - sides.value[0]) / 2, 0.0)[:, None]
    slope = np.where(enough, (sides.slope[1] - sides.slope[0]) / 2, 0.0)[:, None]
    along = regions.along + slope * regions.across
    half = np.maximum(sides.value.mean(0), MIN_HALF_PX)
    return SearchRegions(
        regions.origin_px + value * regions.across,
        along / np.linalg.norm(along, axis=1, keepdims=True),
        np.where(enough, half, regions.half_px),
        regions.span_px,
    )
