"""Compare the edges of masks with the places where the surface of the stem ends in the depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from edgetree.measure.constants.depth import SURFACE_M, SURFACE_STDS
from edgetree.measure.constants.outlines import MIN_INSET_PX
from edgetree.measure.distance_lines import best_distance_lines, masked_means
from edgetree.measure.edge_lines import masked_medians, pick
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.layers import own_readings
from edgetree.measure.regions import OUTWARDS, SearchRegions

# The front of the stems is found from readings at these positions across, in half widths.
_FRONT = np.linspace(-0.6, 0.6, 5)
# The depth is read across each edge of the mask, from this many steps outside to this many inside.
# A step is this fraction of the half width, or at least 1 px.
_STEPS_OUTSIDE, _STEPS_INSIDE = 4, 14
_STEP = 0.03
# The end of the surface is known if at least this share of the readings inwards is on the stem.
_MIN_ON_STEM = 0.75
# The stem ends inside its mask if it does at so many stations, and at this share of those at which
# the mask has an edge.
_MIN_STATIONS, _MIN_SHARE = 4, 0.25


class DepthEdges(NamedTuple):
    """Where the depth shows the ends of T stems' surfaces, at the left and right edges of masks.

    Attributes:
        inset_px: (2, T, S) distance of the end of the surface from the edge of the mask, positive
            inwards.
        known: (2, T, S) whether the readings beyond it are all behind the stem, or missing.
        behind: (2, T, S) whether the reading beside it is behind the stem.
        median_px: (2, T) median of the known `inset_px`; 0 where the edges of mask and depth agree,
            or too few are known.
    """

    inset_px: Float
    known: Bool
    behind: Bool
    median_px: Float


def front_depth_m(frame: DepthFrame, regions: SearchRegions) -> Float:
    """Depth of the front of the stems at the stations, by robust lines of inverse depth.

    Returns:
        (T, S) depths in metres.
    """
    along = regions.stations_px / frame.camera.fx
    across = np.broadcast_to(_FRONT * regions.half_px[:, None, None], (*along.shape, len(_FRONT)))
    xy_px = regions.points(across).reshape(len(along), -1, 2)
    depth_m = frame.depth_at(xy_px)
    on_stem = (frame.mask_probability(xy_px) >= MASK_THRESHOLD).reshape(*along.shape, -1)
    stations_m = np.where(on_stem, depth_m.reshape(on_stem.shape), 0.0)
    edges_px = np.broadcast_to(OUTWARDS * regions.half_px[:, None], (2, *along.shape))
    own = own_readings(frame, regions, edges_px, stations_m, on_stem)
    depth_m = own.depth_m.reshape(depth_m.shape)
    used = depth_m > 0
    depth_m = np.where(used, depth_m, 1.0)
    settings = frame.settings
    noise = np.hypot(settings.depth_noise_per_m, settings.depth_noise_m / depth_m**2)
    lines = best_distance_lines(
        np.repeat(along, len(_FRONT), axis=1),
        1 / depth_m,
        used,
        masked_means(noise, used),
        float(np.radians(settings.lean_std_deg)),
    )
    inverse = lines[:, :1] + lines[:, 1:] * along
    return np.asarray(1 / np.maximum(inverse, 1 / settings.max_range_m))


def find_depth_edges(
    frame: DepthFrame,
    regions: SearchRegions,
    edges_px: Float,
    found: Bool,
    depth_m: Float,
) -> DepthEdges:
    """Find where the stems' surfaces end in the depth, from outside inwards.

    Args:
        frame: Depth and camera.
        regions: Search regions.
        edges_px: (2, T, S) left and right edges of the masks across the regions.
        found: (2, T, S) which of these were found.
        depth_m: (T, S) depth of the front of the stems at the stations.
    """
    settings = frame.settings
    step_px = np.maximum(_STEP * regions.half_px, 1.0)
    inwards_px = np.arange(-_STEPS_OUTSIDE, _STEPS_INSIDE) * step_px[:, None]
    across = edges_px[..., None] - OUTWARDS[..., None] * inwards_px[:, None]
    read_m = frame.depth_at(regions.points(across))
    radius_m = (edges_px[1] - edges_px[0]) / 2 * depth_m / frame.camera.fx
    noise_m = np.hypot(settings.depth_noise_per_m * depth_m**2, settings.depth_noise_m)
    reach_m = (radius_m + SURFACE_STDS * noise_m + SURFACE_M)[..., None]
    behind_m, read = read_m - depth_m[..., None], read_m > 0
    on_stem = read & (np.abs(behind_m) <= reach_m)
    first = (on_stem | (read & (behind_m < -reach_m))).argmax(-1)
    index = np.maximum(first, 1)
    inner = np.arange(on_stem.shape[-1]) >= index[..., None]
    share = (on_stem & inner).sum(-1) / (on_stem.shape[-1] - index)
    known = found & pick(on_stem, index) & (first > 0) & (share >= _MIN_ON_STEM)
    inset_px = (index - _STEPS_OUTSIDE - 0.5) * step_px[:, None]
    median_px = masked_medians(inset_px, known)
    enough = known.sum(2) >= np.maximum(_MIN_STATIONS, _MIN_SHARE * found.sum(2))
    inside = enough & (median_px > np.maximum(MIN_INSET_PX, step_px))
    return DepthEdges(
        inset_px,
        known,
        known & (pick(read_m, index - 1) > 0),
        np.where(inside, median_px, 0.0),
    )
