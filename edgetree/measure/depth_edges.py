"""Compare the edges of masks with the places where the surface of the stem ends in the depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from edgetree.measure.constants.depth import SURFACE_M, SURFACE_STDS
from edgetree.measure.constants.outlines import (
    MIN_INSET_PX,
    MIN_RAMP_CONTRAST,
    MIN_RAMP_PX,
    RAMP_END,
)
from edgetree.measure.distance_lines import best_distance_lines, masked_means
from edgetree.measure.edge_lines import masked_medians, median, pick
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.layers import own_readings
from edgetree.measure.regions import OUTWARDS, SearchRegions

# The front of the stems is found from readings at these positions across, in half widths.
_FRONT = np.linspace(-0.6, 0.6, 5)
# The depth is read across each edge of the mask, from this many steps outside to this many inside.
# A step is this fraction of the half width, or at least 1 px.
_STEPS_OUTSIDE, _STEPS_INSIDE = 9, 14
_STEP = 0.03
# The end of the surface is known if at least this share of the readings inwards is on the stem.
_MIN_ON_STEM = 0.75
# The stem ends inside its mask if it does at so many stations, and at this share of those at which
# the mask has an edge.
_MIN_STATIONS, _MIN_SHARE = 4, 0.25
# The width of ramps is the median of at least so many in a frame.
_MIN_RAMPS = 12


class DepthEdges(NamedTuple):
    """Where the depth shows the ends of T stems' surfaces, at the left and right edges of masks.

    Attributes:
        inset_px: (2, T, S) distance of the end of the surface from the edge of the mask, positive
            inwards, without `shift_px`. Where the depth changes gradually from the stem to what is
            behind it, the end is the middle of this ramp.
        known: (2, T, S) whether the readings beyond it are all behind the stem, or missing.
        behind: (2, T, S) whether the reading beside it is behind the stem.
        median_px: (2, T) median of the known `inset_px`; 0 where the edges of mask and depth agree,
            or too few are known.
        enough: (2, T) whether enough of them are known.
        outermost_px: (2, T, S) as `inset_px`, of the outermost reading found on the stem.
        shift_px: (T,) how far the depth lies to the right of the mask, across the stem.
        ramp_px: Width of the ramp in the depth at the edges of the frame's stems; 0 for steps.
    """

    inset_px: Float
    known: Bool
    behind: Bool
    median_px: Float
    enough: Bool
    outermost_px: Float
    shift_px: Float
    ramp_px: float

    @classmethod
    def unknown(cls, found: Bool) -> DepthEdges:
        """Where single beams show no edges; `found` (2, T, S) are those of the masks."""
        nowhere, zeros = np.zeros_like(found), np.zeros(found.shape)
        side_px = zeros[..., 0]
        return cls(zeros, nowhere, nowhere, side_px, nowhere[..., 0], zeros, side_px[0], 0.0)


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
    own = own_readings(frame, regions, edges_px, stations_m, on_stem, None)
    depth_m = own.depth_m.reshape(depth_m.shape)
    used = depth_m > 0
    depth_m = np.where(used, depth_m, 1.0)
    settings = frame.settings
    noise = settings.depth_stds_m(depth_m) / depth_m**2
    lines = best_distance_lines(
        np.repeat(along, len(_FRONT), axis=1),
        1 / depth_m,
        used,
        masked_means(noise, used),
        float(np.radians(settings.lean_std_deg)),
    )
    inverse = lines[:, :1] + lines[:, 1:] * along
    return np.asarray(1 / np.maximum(inverse, 1 / settings.max_range_m))


def search_step_px(regions: SearchRegions) -> Float:
    """(T,) distance of the places across the stems at which their depth is read."""
    return np.asarray(np.maximum(_STEP * regions.half_px, 1.0))


def surface_reach_m(frame: DepthFrame, edges_px: Float, depth_m: Float) -> Float:
    """(T, S) by how much readings on the stems differ from the depth of their front at most.

    Args:
        frame: Camera and settings.
        edges_px: (2, T, S) left and right edges of the masks across the regions.
        depth_m: (T, S) depth of the front of the stems.
    """
    radius_m = (edges_px[1] - edges_px[0]) / 2 * depth_m / frame.camera.fx
    noise_m = frame.settings.depth_stds_m(depth_m)
    return np.asarray(radius_m + SURFACE_STDS * noise_m + SURFACE_M)


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
    step_px = search_step_px(regions)
    inwards_px = np.arange(-_STEPS_OUTSIDE, _STEPS_INSIDE) * step_px[:, None]
    across = edges_px[..., None] - OUTWARDS[..., None] * inwards_px[:, None]
    read_m = frame.depth_at(regions.points(across))
    radius_m = (edges_px[1] - edges_px[0]) / 2 * depth_m / frame.camera.fx
    reach_m = surface_reach_m(frame, edges_px, depth_m)[..., None]
    behind_m, read = read_m - depth_m[..., None], read_m > 0
    on_stem = read & (np.abs(behind_m) <= reach_m)
    first = (on_stem | (read & (behind_m < -reach_m))).argmax(-1)
    index = np.maximum(first, 1)
    inner = np.arange(on_stem.shape[-1]) >= index[..., None]
    share = (on_stem & inner).sum(-1) / (on_stem.shape[-1] - index)
    known = found & pick(on_stem, index) & (first > 0) & (share >= _MIN_ON_STEM)
    # A filter that averages stem and background makes a ramp. Its middle is the edge.
    beside_m = pick(behind_m, read.argmax(-1))
    ramp = read & ~inner
    middle_m = (beside_m + radius_m / 2) / 2
    outer_half = (ramp & (behind_m < middle_m[..., None])).sum(-1)
    inset_px = (index - outer_half - _STEPS_OUTSIDE - 0.5) * step_px[:, None]
    enough = known.sum(2) >= np.maximum(_MIN_STATIONS, _MIN_SHARE * found.sum(2))
    shift_px = _shifts_px(masked_medians(inset_px, known), enough)
    inset_px = inset_px + OUTWARDS * shift_px[:, None]
    median_px = masked_medians(inset_px, known)
    inside = enough & (median_px > np.maximum(MIN_INSET_PX, step_px))
    behind = known & pick(read, index - 1)
    clear = behind & (beside_m > MIN_RAMP_CONTRAST * reach_m[..., 0])
    steps = (ramp & (behind_m < RAMP_END * beside_m[..., None])).sum(-1)
    seen_share = RAMP_END - reach_m[..., 0] / np.where(clear, beside_m, np.inf)
    widths_px = (steps * step_px[:, None] / seen_share)[clear]
    ramp_px = median(widths_px) if len(widths_px) >= _MIN_RAMPS else 0.0
    return DepthEdges(
        inset_px=inset_px,
        known=known,
        behind=behind,
        median_px=np.where(inside, median_px, 0.0),
        enough=enough,
        outermost_px=(index - _STEPS_OUTSIDE) * step_px[:, None],
        shift_px=shift_px,
        ramp_px=ramp_px if ramp_px >= MIN_RAMP_PX else 0.0,
    )


def _shifts_px(median_px: Float, enough: Bool) -> Float:
    """(T,) how far the depth of stems lies to the right of their masks.

    Depth that ends inside the mask on one side and outside it on the other is shifted by the
    smaller of both distances. Stems of which one side is known have the median of the others.

    Args:
        median_px: (2, T) insets of the left and the right edges.
        enough: (2, T) whether they are known.
    """
    left, right = median_px
    both = enough.all(0)
    opposite = left * right < 0
    size = np.where(opposite, np.minimum(np.abs(left), np.abs(right)), 0.0)
    shift_px = np.sign(left) * size
    common_px = median(shift_px[both]) if both.any() else 0.0
    return np.where(both, shift_px, common_px)
