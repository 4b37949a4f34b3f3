"""How far the edges of a network's masks are from those in the depth image.

Where a network puts an edge depends on how the cameras of its training drew it. So the edges of all
masks and keypoints of a frame share an offset, which the depth image tells, and each mask adds its
own. The mask says where to look; the depth image decides, as far as its edges are better known.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from basetree.normal import MAD_TO_STD
from edgetree.measure.constants.edges import STATIONS_PER_END
from edgetree.measure.depth_edges import DepthEdges
from edgetree.measure.drawn_edges import DrawnEdges
from edgetree.measure.edge_lines import fit_lines, masked_medians, median
from edgetree.measure.regions import SearchRegions
from edgetree.measure.surface_ends import SurfaceEnds

# Rounds of reweighted least squares, and the standard deviation of a normal distribution per median
# of its absolute values.
_ROUNDS = 2


class EdgeOffsets(NamedTuple):
    """Corrections of the edges of T masks.

    Attributes:
        inwards_px: (2, T, S) how far to move the left and right edges inwards.
        std_px: (T,) standard deviation of an edge after that.
        common_px: How far to move edges by keypoints inwards.
    """

    inwards_px: Float
    std_px: Float
    common_px: float


def edge_offsets(
    regions: SearchRegions,
    depth: DepthEdges,
    ends: SurfaceEnds,
    moves: Bool,
    mask_std_px: Float,
) -> EdgeOffsets:
    """Weigh the edges of masks and of the depth by their variances.

    Straight lines along each side of a stem are fitted to the offsets of its stations. Sides that
    show too few edges in the depth have the offset that the frame's other sides share, and keep the
    error of the mask.

    Args:
        regions: Search regions.
        depth: Edges in the depth.
        ends: The same, reading by reading.
        moves: (2, T) which sides are those of the depth anyway: what is wrong with their masks is
            not the camera's way to draw edges.
        mask_std_px: (T,) standard deviations of the masks' edges.
    """
    # The middle of a ramp is the edge, anywhere in the ramp (the deviation of an even spread).
    ramp_std_px = depth.ramp_px / math.sqrt(12)
    drawn = DrawnEdges(0.0, ramp_std_px) if depth.ramp_px else ends.drawn
    offset_px = np.where(depth.known, ends.inset_px + drawn.outwards_px, 0.0)
    line_px, line_std_px = _lines(regions, offset_px, depth.known)
    shared_std_px = np.hypot(drawn.std_px, depth.shift_px / 2)
    own = depth.enough & ~moves
    common_px, common = np.zeros(len(mask_std_px)), own & (depth.median_px == 0)
    if common.any():
        side_px = np.median(line_px, axis=2)[common]
        middle_px = median(side_px)
        spread_px = MAD_TO_STD * median(np.abs(side_px - middle_px))
        common_std_px = np.hypot(shared_std_px, spread_px / math.sqrt(len(side_px)))
        common_px = middle_px * mask_std_px**2 / (mask_std_px**2 + common_std_px**2)
    own_std_px = np.hypot(shared_std_px, line_std_px)
    trust = np.where(own, mask_std_px**2 / (mask_std_px**2 + own_std_px**2), 0.0)
    # The depth tells where edges are in the mean. The errors of the mask's shape stay.
    std_px = np.hypot(mask_std_px, (trust * shared_std_px).max(0))
    trust = trust[..., None]
    inwards_px = trust * line_px + (1 - trust) * common_px[:, None]
    return EdgeOffsets(inwards_px, std_px, median(common_px))


def _lines(regions: SearchRegions, offset_px: Float, known: Bool) -> tuple[Float, Float]:
    """(2, T, S) robust lines through the offsets, and (2, T) the standard deviations of these."""
    weight = known.astype(np.float64)
    line_px = np.broadcast_to(masked_medians(offset_px, known)[..., None], offset_px.shape)
    scatter_px: Float = np.ones(offset_px.shape[:2])
    for _ in range(_ROUNDS):
        off_px = np.abs(offset_px - line_px)
        scatter_px = MAD_TO_STD * masked_medians(off_px, known)
        tolerance_px = 3 * np.maximum(scatter_px, 0.5)[..., None]
        weight = known * np.maximum(1 - (off_px / tolerance_px) ** 2, 0.0) ** 2
        value, slope = fit_lines(regions.stations_px, offset_px, weight)
        line_px = value[..., None] + slope[..., None] * regions.stations_px
    count = np.maximum(weight.sum(2) / STATIONS_PER_END, 1.0)
    return line_px, np.maximum(scatter_px, 0.5) / np.sqrt(count)
