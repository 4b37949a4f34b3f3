"""Find the left and right edges of masks across search regions."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Bool, Float, Index
from calib.directions import unit
from edgetree.measure.edge_lines import outer_lines, pick
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.regions import MIN_HALF_PX, OUTWARDS, STATIONS, SearchRegions

# Edges are searched for across this many half widths, with this many samples. A second search
# around each edge found takes more samples over this part of the half width, or at least px.
_SEARCH_HALF_WIDTHS = 1.8
_COARSE_SAMPLES, _FINE_SAMPLES = 25, 13
_COARSE = np.linspace(-_SEARCH_HALF_WIDTHS, _SEARCH_HALF_WIDTHS, _COARSE_SAMPLES)
_FINE = np.linspace(-1.0, 1.0, _FINE_SAMPLES)
_FINE_REACH, _MIN_FINE_REACH_PX = 0.12, 1.5
# With fewer stations than this a search region is not realigned: lines need some in each quarter.
_MIN_STATIONS = 6

COARSE_STEP = 2 * _SEARCH_HALF_WIDTHS / (_COARSE_SAMPLES - 1)
"""Distance of the samples of a coarse search, in half widths."""


def coarse_edges(frame: DepthFrame, regions: SearchRegions) -> tuple[Float, Bool]:
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


def fine_edges(
    frame: DepthFrame, regions: SearchRegions, edges_px: Float, border_px: Float
) -> tuple[Float, Bool]:
    """Refine coarse edges.

    Args:
        frame: The masks.
        regions: Search regions.
        edges_px: (2, T, S) left and right edges in px across the regions.
        border_px: (2, T) edges closer than this to the border of the image do not count.

    Returns:
        (2, T, S) edges, and where they were found.
    """
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


def realigned(regions: SearchRegions, edges_px: Float, seen: Bool) -> SearchRegions:
    """Move and turn the regions to lie midway between the lines along both edges."""
    enough = seen.sum(1) >= _MIN_STATIONS
    sides = outer_lines(regions, edges_px, seen)
    value = np.where(enough, (sides.value[1] - sides.value[0]) / 2, 0.0)[:, None]
    slope = np.where(enough, (sides.slope[1] - sides.slope[0]) / 2, 0.0)[:, None]
    half = np.maximum(sides.value.mean(0), MIN_HALF_PX)
    return SearchRegions(
        regions.origin_px + value * regions.across,
        unit(regions.along + slope * regions.across),
        np.where(enough, half, regions.half_px),
        regions.span_px,
    )


def _crossing(probability: Float, inner: Index, outer: Index) -> Float:
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
