"""Where the surfaces of stems end in the depth, reading by reading."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from basetree.normal import MAD_TO_STD
from edgetree.measure.depth_edges import DepthEdges, search_step_px, surface_reach_m
from edgetree.measure.drawn_edges import UNKNOWN, DrawnEdges, beside, drawn_edges
from edgetree.measure.edge_lines import fit_lines, median, pick
from edgetree.measure.frame import DepthFrame
from edgetree.measure.regions import OUTWARDS, SearchRegions

# Around the end of a surface, readings are looked at from so many inside it to so many outside,
# where the background shows again.
_INSIDE, _OUTSIDE = 2, 6
_AROUND = np.arange(-_INSIDE, _OUTSIDE + 1)
# A reading that is nearer than this share of the way to the background is of both surfaces.
_MIXED_SHARE = 0.75
# The roughness of edges is known from at least so many ends in a frame.
_MIN_ENDS = 12
# Standard deviation of a normal distribution per median of its absolute values.


class SurfaceEnds(NamedTuple):
    """The ends of the surfaces of T stems, at the left and right edges of their masks.

    Attributes:
        inset_px: (2, T, S) distance of the end from the edge of the mask, as in `DepthEdges`, but
            to a fraction of a reading.
        drawn: How the camera draws edges.
    """

    inset_px: Float
    drawn: DrawnEdges


def surface_ends(
    frame: DepthFrame, regions: SearchRegions, edges_px: Float, depth: DepthEdges, depth_m: Float
) -> SurfaceEnds:
    """Look at the readings around the ends of surfaces one by one.

    Args:
        frame: Depth and camera.
        regions: Search regions.
        edges_px: (2, T, S) left and right edges of the masks across the regions.
        depth: The ends that a coarse search found.
        depth_m: (T, S) depth of the front of the stems at the stations.
    """
    step_px = search_step_px(regions)
    unit_px = np.maximum(step_px / _INSIDE, frame.steps.side_px)[:, None, None]
    across_px = edges_px - OUTWARDS * depth.outermost_px
    outwards_px = OUTWARDS[..., None] * unit_px * _AROUND
    read_m = frame.depth_at(regions.points(across_px[..., None] + outwards_px))
    reach_m = surface_reach_m(frame, edges_px, depth_m)[..., None]
    behind_m, read = read_m - depth_m[..., None], read_m > 0
    on_stem = read & (np.abs(behind_m) <= reach_m) & (_AROUND <= _INSIDE)
    end = len(_AROUND) - 1 - on_stem[..., ::-1].argmax(-1)
    beyond = read & (np.arange(len(_AROUND)) > end[..., None])
    first, last = beyond.argmax(-1), len(_AROUND) - 1 - read[..., ::-1].argmax(-1)
    background_m = pick(behind_m, last)
    seen = depth.known & beyond.any(-1) & (background_m > reach_m[..., 0])
    # A surface at that distance would go on.
    mixed = read & (behind_m < _MIXED_SHARE * background_m[..., None])
    single = pick(mixed, first) & ~pick(mixed, np.minimum(first + 1, len(_AROUND) - 1))
    # The last reading is that of its whole pixel, or square of pixels.
    end_px = across_px + pick(np.broadcast_to(outwards_px, read.shape), end)
    end_px = _reading_middles(frame, regions, end_px) + OUTWARDS * unit_px[..., 0] / 2
    # `inset_px` of the coarse search is half a step inwards of the outermost reading, or further in
    # a ramp.
    inset_px = depth.inset_px + step_px[:, None] / 2 - OUTWARDS * (end_px - across_px)
    roughness_px = _roughness_px(regions, OUTWARDS * edges_px - inset_px, depth.known, step_px)
    kinds = np.where(seen, beside(first - end - 1, single, seen), UNKNOWN)
    return SurfaceEnds(inset_px, drawn_edges(kinds, roughness_px, frame.steps))


def _roughness_px(regions: SearchRegions, outward_px: Float, known: Bool, step_px: Float) -> float:
    """Standard deviation of the ends of surfaces about straight lines, from its median.

    Args:
        regions: Search regions.
        outward_px: (2, T, S) ends of the surfaces, outwards from the centre line.
        known: (2, T, S) which are known.
        step_px: (T,) how finely they were searched for; coarsely searched ones do not count.
    """
    known = known & (step_px <= _INSIDE)[:, None]
    ends_px = np.where(known, outward_px, 0.0)
    value, slope = fit_lines(regions.stations_px, ends_px, known.astype(np.float64))
    off_px = np.abs(ends_px - value[..., None] - slope[..., None] * regions.stations_px)
    # A pixel is wider across a stem that leans in the image.
    off_px = (off_px / np.abs(regions.across).sum(1)[:, None])[known]
    return median(off_px) * MAD_TO_STD if len(off_px) >= _MIN_ENDS else math.nan


def _reading_middles(frame: DepthFrame, regions: SearchRegions, across_px: Float) -> Float:
    """Places (2, T, S) across the regions of the middles of the readings at other places there."""
    if frame.rotation is not None:
        return across_px
    side_px = frame.steps.side_px
    xy_px = regions.points(across_px[..., None])[..., 0, :]
    middle_px = (np.floor(xy_px / side_px) + 0.5) * side_px
    return np.asarray(across_px + np.vecdot(middle_px - xy_px, regions.across[:, None]))
