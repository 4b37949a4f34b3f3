"""Find the left and right edges of stems in their masks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.depth_edges import find_depth_edges, front_depth_m
from edgetree.measure.edge_lines import OuterLines, fit_lines, outer_lines, pick
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.regions import (
    MIN_HALF_PX,
    OUTWARDS,
    STATIONS,
    SearchRegions,
    clean_rows,
    line_spans,
    mask_moments,
)
from edgetree.measure.section import lengths

__all__ = ["Outline", "regions_from_masks", "trace_outline"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]
Rows = NDArray[np.intp]

# Edges are searched for across this many half widths, with this many samples. A second search
# around each edge found takes more samples over this part of the half width, or at least px.
_SEARCH_HALF_WIDTHS = 1.8
_COARSE_SAMPLES, _FINE_SAMPLES = 25, 13
_COARSE = np.linspace(-_SEARCH_HALF_WIDTHS, _SEARCH_HALF_WIDTHS, _COARSE_SAMPLES)
_FINE = np.linspace(-1.0, 1.0, _FINE_SAMPLES)
_FINE_REACH, _MIN_FINE_REACH_PX = 0.12, 1.5
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
        edges_px: (2, T, S) positions of the left and right edges across the region.
        valid: (2, T, S) whether these are edges of the stem itself.
        visible_fraction: (T,) fraction of the stations at which the mask shows both sides.
        std_px: (T,) standard deviation of an edge.
    """

    regions: SearchRegions
    edges_px: Float
    valid: Flags
    visible_fraction: Float
    std_px: Float

    @property
    def scatter_px(self) -> Float:
        """(T,) root mean square distance of the valid edges from straight lines along them."""
        position, edges_px = self.regions.stations_px, np.where(self.valid, self.edges_px, 0.0)
        value, slope = fit_lines(position, edges_px, self.valid.astype(np.float64))
        residual = edges_px - value[..., None] - slope[..., None] * position
        squares = np.where(self.valid, residual**2, 0.0).sum((0, 2))
        count = np.maximum(self.valid.sum(2) - 2, 0).sum(0)
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
        edges_px, seen = _coarse_edges(frame, regions)
        straight = outer_lines(regions, edges_px, seen).agreeing
        border_px = _BORDER * regions.half_px[:, None, None]
        within = frame.inside(regions.points(edges_px[..., None]), border_px)[..., 0]
        agreeing = int((straight & within).sum())
        regions = _realigned(regions, edges_px, seen)
    return regions, agreeing


def trace_outline(frame: DepthFrame, regions: SearchRegions, border_px: Float) -> Outline:
    """Find both edges of every stem at every station.

    A coarse search first aligns the search regions with the masks, then a fine search locates the
    edges. Where the depth shows that a stem's surface ends inside its mask, the edges are moved
    there. Edges that contradict the depth or each other have a larger standard deviation.

    Args:
        frame: the frame, with one mask per stem.
        regions: where to search.
        border_px: (2, T) left and right edges closer than this to the border of the image are not
            valid, since there the image ends and not the stem.
    """
    regions = _realigned(regions, *_coarse_edges(frame, regions))
    coarse_px, seen = _coarse_edges(frame, regions)
    edges_px, found = _fine_edges(frame, regions, coarse_px, border_px)
    found &= seen
    depth = find_depth_edges(frame, regions, edges_px, found, front_depth_m(frame, regions))
    # Missing readings alone may be a fault of the depth, so they do not move the edges.
    moves = (depth.median_px > 0) & (depth.behind.sum(2) >= 0.5 * depth.known.sum(2))
    found = np.where(moves[..., None], depth.known, found)
    edges_px -= OUTWARDS * np.where(moves[..., None] & depth.known, depth.inset_px, 0.0)
    lines = outer_lines(regions, edges_px, found, depth.behind)
    inside_px = np.where(moves, 0.0, depth.median_px)
    contradiction_px = _contradiction_px(regions, lines, edges_px, found, depth.known)
    std_px = np.hypot(frame.mask_std_px(), np.hypot(inside_px, contradiction_px).max(0))
    return Outline(regions, edges_px, lines.agreeing, seen.mean(1), std_px)


def _contradiction_px(
    regions: SearchRegions, lines: OuterLines, edges_px: Float, found: Flags, ends: Flags
) -> Float:
    """(2, T) root mean square distance by which edges where the stem ends lie inside the lines."""
    line_px = lines.value[..., None] + lines.slope[..., None] * regions.stations_px
    inside_px = np.maximum(line_px - OUTWARDS * edges_px, 0.0)
    contradicts = ends & found & ~lines.agreeing & (inside_px > 0)
    count = np.maximum(found.sum(2), 1)
    many = contradicts.sum(2) >= _MIN_CONTRADICTING * count
    squares = np.where(contradicts, inside_px**2, 0.0).sum(2)
    return np.where(many, np.sqrt(squares / count), 0.0)


def _coarse_edges(frame: DepthFrame, regions: SearchRegions) -> tuple[Float, Flags]:
    """(2, T, S) left and right edges in px across the regions, and (T, S) where both were found."""
    half_px, last = regions.half_px[:, None], _COARSE_SAMPLES - 1
    across = np.broadcast_to(_COARSE * half_px[..., None], (len(half_px), STATIONS, len(_COARSE)))
    probability = frame.mask_probability(regions.points(across))
    inside = probability >= MASK_THRESHOLD
    first = np.stack([inside.argmax(-1), last - inside[..., ::-1].argmax(-1)])
    inner = np.clip(first, 1, last - 1)
    sample = _crossing(probability, inner, inner + OUTWARDS.astype(np.intp))
    edges_px = (2 * sample / last - 1) * _SEARCH_HALF_WIDTHS * half_px
    return edges_px, inside.any(-1) & ~inside[..., 0] & ~inside[..., -1]


def _fine_edges(
    frame: DepthFrame, regions: SearchRegions, edges_px: Float, border_px: Float
) -> tuple[Float, Flags]:
    """Refine (2, T, S) edges; also return where an edge was found."""
    reach_px = np.maximum(_FINE_REACH * regions.half_px, _MIN_FINE_REACH_PX)[:, None]
    across = edges_px[..., None] - (OUTWARDS * reach_px)[..., None] * _FINE
    points = regions.points(across)
    probability = frame.mask_probability(points.swapaxes(0, 1)).swapaxes(0, 1)
    inside = probability >= MASK_THRESHOLD
    inner = np.maximum(inside.argmax(-1), 1)
    sample = _crossing(probability, inner, inner - 1)
    edges_px = edges_px - OUTWARDS * reach_px * (2 * sample / (_FINE_SAMPLES - 1) - 1)
    points = regions.points(edges_px[..., None])[..., 0, :]
    seen = inside.any(-1) & ~inside[..., 0] & frame.inside(points, border_px[..., None])
    return edges_px, seen


def _crossing(probability: Float, inner: Rows, outer: Rows) -> Float:
    """Where masks rise above the threshold, linearly interpolated between two samples.

    Args:
        probability: (T, S, C) or (2, T, S, C) samples of the masks.
        inner: (2, T, S) numbers of the samples above the threshold.
        outer: (2, T, S) those of their neighbours below it.

    Returns:
        (2, T, S) places in the same numbers.
    """
    high, low = pick(probability, inner), pick(probability, outer)
    rise = np.where(high > low, high - low, 1.0)
    share = np.divide(MASK_THRESHOLD - low, rise, dtype=np.float64)
    return np.asarray(outer + (inner - outer) * share)


def _realigned(regions: SearchRegions, edges_px: Float, seen: Flags) -> SearchRegions:
    """Move and turn the regions to lie midway between the lines along both edges."""
    enough = seen.sum(1) >= _MIN_STATIONS
    sides = outer_lines(regions, edges_px, seen)
    value = np.where(enough, (sides.value[1] - sides.value[0]) / 2, 0.0)[:, None]
    slope = np.where(enough, (sides.slope[1] - sides.slope[0]) / 2, 0.0)[:, None]
    along = regions.along + slope * regions.across
    half = np.maximum(sides.value.mean(0), MIN_HALF_PX)
    return SearchRegions(
        regions.origin_px + value * regions.across,
        along / lengths(along)[:, None],
        np.where(enough, half, regions.half_px),
        regions.span_px,
    )
