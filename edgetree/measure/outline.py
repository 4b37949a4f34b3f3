"""The edges of stems in their masks, checked by the depth beside them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.measure.constants.depth import NEARER_M, NEARER_SHARE
from edgetree.measure.constants.outlines import (
    BORDER_MASK_STDS,
    CLIPPED_GAP_PX,
    GIVEN_BORDER_PX,
    MIN_CONTRADICTING_SHARE,
    MIN_INSET_PX,
    NETWORK_BORDER_PX,
)
from edgetree.measure.depth_edges import DepthEdges, find_depth_edges, front_depth_m
from edgetree.measure.edge_lines import OuterLines, fit_lines, outer_lines
from edgetree.measure.edge_offsets import edge_offsets
from edgetree.measure.frame import DepthFrame
from edgetree.measure.keypoints import Keypoints
from edgetree.measure.mask_edges import coarse_edges, fine_edges, realigned
from edgetree.measure.regions import OUTWARDS, SearchRegions
from edgetree.measure.settings import reference_px
from edgetree.measure.surface_ends import surface_ends

# An object in front of a stem is searched for this far from the stem's edge, in half widths or px.
_BESIDE, _MIN_BESIDE_PX = 0.15, 3.0
# A side with fewer edges than this has none.
_MIN_EDGES = 4


@dataclass(frozen=True, eq=False)
class Outline:
    """The edges of T stems in their masks, at S stations.

    Attributes:
        regions: Search regions.
        edges_px: (2, T, S) positions of the left and right edges across the region.
        found: (2, T, S) where they were found.
        valid: (2, T, S) whether these are edges of the stem itself.
        visible_fraction: (T,) fraction of the stations at which the mask shows both sides.
        std_px: (T,) standard deviation of an edge.
        depth_shift_px: (T,) how far the depth lies to the right of the mask; 0 below
            `MIN_INSET_PX`.
        depth_ramp_px: Width of the ramp in the depth at the edges of the stems; 0 for steps.
        keypoints_inwards_px: How far keypoints of edges lie outside of the edges.
    """

    regions: SearchRegions
    edges_px: Float
    found: Bool
    valid: Bool
    visible_fraction: Float
    std_px: Float
    depth_shift_px: Float
    depth_ramp_px: float
    keypoints_inwards_px: float = 0.0

    def of(self, stems: Index) -> Outline:
        """The outlines of some of the stems, chosen by their numbers."""
        return replace(
            self,
            regions=self.regions.of(stems),
            edges_px=self.edges_px[:, stems],
            found=self.found[:, stems],
            valid=self.valid[:, stems],
            visible_fraction=self.visible_fraction[stems],
            std_px=self.std_px[stems],
            depth_shift_px=self.depth_shift_px[stems],
        )

    @property
    def smoothed_away(self) -> Bool:
        """(T,) whether nearly every depth reading on a stem is mixed with what is beside it."""
        clear_px = self.regions.half_px - self.depth_ramp_px / 2
        return np.asarray((self.depth_ramp_px > 0) & (clear_px < MIN_INSET_PX))

    @property
    def scatter_px(self) -> Float:
        """(T,) root mean square distance of the valid edges from straight lines along them."""
        position, edges_px = self.regions.stations_px, np.where(self.valid, self.edges_px, 0.0)
        value, slope = fit_lines(position, edges_px, self.valid.astype(np.float64))
        residual = edges_px - value[..., None] - slope[..., None] * position
        squares = np.where(self.valid, residual**2, 0.0).sum((0, 2))
        count = np.maximum(self.valid.sum(2) - 2, 0).sum(0)
        return np.asarray(np.sqrt(squares / np.maximum(count, 1)))

    def without_occluded_edges(self, frame: DepthFrame, depth_m: Float) -> Outline:
        """The outline without edges beside which something nearer may hide the stem's edge.

        Where nothing is read beside an edge, it is hidden if another stem hides the next ones above
        and below. A side of which hardly an edge is left has none.

        Args:
            frame: Depth and settings.
            depth_m: (T,) depth of the stems.
        """
        regions, stem = self.regions, depth_m[:, None, None]
        nearer = stem * NEARER_SHARE - 3 * frame.settings.depth_stds_m(stem) - NEARER_M
        step_px = np.maximum(_BESIDE * regions.half_px, _MIN_BESIDE_PX)[:, None]
        outwards_px = OUTWARDS * step_px
        beside = np.stack([self.edges_px + times * outwards_px for times in (1, 2)], -1)
        beside_px = regions.points(beside)
        depth = frame.depth_at(beside_px)
        read: Bool = np.asarray((depth > 0).any(-1))
        before: Bool = np.asarray((depth > 0) & (depth < nearer))
        hidden: Bool = np.asarray(before.any(-1))
        # Missing readings tell nothing: those at the next stations do.
        before[before] = frame.on_any_stem(beside_px[before][None])[0]
        by_stem: Bool = np.asarray(before.any(-1))
        rows = by_stem.any(-1) & ~read.all(-1)
        if rows.any():
            hidden[rows] |= ~read[rows] & _between(by_stem[rows], read[rows])
        valid = self.valid & ~hidden
        return replace(self, valid=valid & (valid.sum(2, keepdims=True) >= _MIN_EDGES))


def _between(flags: Bool, known: Bool) -> Bool:
    """(N, S) whether flags (N, S) are set at the nearest known stations on both sides."""
    station = np.arange(known.shape[-1])
    before = np.maximum.accumulate(np.where(known, station, -1), -1)
    after = np.minimum.accumulate(np.where(known, station, station[-1] + 1)[..., ::-1], -1)
    ended = np.zeros((len(flags), len(station) + 2), np.bool_)
    ended[:, 1:-1] = flags
    sides = [np.take_along_axis(ended, side + 1, -1) for side in (before, after[..., ::-1])]
    return np.asarray(sides[0] & sides[1])


def trace_outline(frame: DepthFrame, regions: SearchRegions, keypoints: Keypoints) -> Outline:
    """Find both edges of every stem at every station.

    A coarse search first aligns the search regions with the masks, then a fine search locates the
    edges. Where the depth shows that a stem's surface ends inside its mask, the edges are moved
    there. Edges that contradict the depth or each other have a larger standard deviation.

    Args:
        frame: The frame, with one mask per stem.
        regions: Where to search.
        keypoints: Keypoints of the same trees.
    """
    regions = realigned(regions, *coarse_edges(frame, regions))
    coarse_px, seen = coarse_edges(frame, regions)
    edges_px, found = fine_edges(frame, regions, coarse_px, _border_px(frame, keypoints))
    found &= seen
    if frame.is_sparse:
        depth = DepthEdges.unknown(found)
    else:
        front_m = front_depth_m(frame, regions)
        depth = find_depth_edges(frame, regions, edges_px, found, front_m)
    # Missing readings alone may be a fault of the depth, so they do not move the edges.
    moves = (depth.median_px > 0) & (depth.behind.sum(2) >= 0.5 * depth.known.sum(2))
    found = np.where(moves[..., None], depth.known, found)
    inwards_px = np.where(moves[..., None] & depth.known, depth.inset_px, 0.0)
    mask_std_px, keypoints_px = frame.mask_std_px, 0.0
    if frame.by_network and not frame.is_sparse:
        ends = surface_ends(frame, regions, edges_px, depth, front_m)
        offsets = edge_offsets(regions, depth, ends, moves, mask_std_px)
        inwards_px += np.where(moves[..., None], 0.0, offsets.inwards_px)
        mask_std_px, keypoints_px = offsets.std_px, offsets.common_px
    edges_px -= OUTWARDS * inwards_px
    lines = outer_lines(regions, edges_px, found, depth.behind)
    inside_px = np.where(moves, 0.0, depth.median_px)
    contradiction_px = _contradiction_px(regions, lines, edges_px, found, depth.known)
    std_px = np.hypot(mask_std_px, np.hypot(inside_px, contradiction_px).max(0))
    # Where edges come from the depth, they may be anywhere in its ramp (the deviation of an even
    # spread). Background that a filter grows into the stem looks like a mask that is too wide, so
    # edges that are moved have the depth's own error, the same on both sides.
    moved = moves.any(0)
    apart = frame.masks_given or frame.by_network
    ramp_px = np.where(moved | (not apart), depth.ramp_px / np.sqrt(12), 0.0)
    std_px = np.hypot(std_px, np.hypot(ramp_px, np.where(moved, np.sqrt(2) * MIN_INSET_PX, 0.0)))
    shift_px = np.where(np.abs(depth.shift_px) >= MIN_INSET_PX, depth.shift_px, 0.0)
    return Outline(
        regions=regions,
        edges_px=edges_px,
        found=found,
        valid=lines.agreeing,
        visible_fraction=seen.mean(1),
        std_px=std_px,
        depth_shift_px=shift_px,
        depth_ramp_px=depth.ramp_px,
        keypoints_inwards_px=keypoints_px,
    )


def _border_px(frame: DepthFrame, keypoints: Keypoints) -> Float:
    """(2, T) px from the border within which edges are those of the image, not of the stem."""
    clipped = keypoints.clipped_by_side.T
    if frame.masks_given:
        border_px = np.full(clipped.shape, GIVEN_BORDER_PX)
    else:
        px = np.where(clipped, CLIPPED_GAP_PX, NETWORK_BORDER_PX)
        border_px = px * reference_px(frame.camera.width)
    return np.asarray(border_px + BORDER_MASK_STDS * frame.mask_std_px)


def _contradiction_px(
    regions: SearchRegions, lines: OuterLines, edges_px: Float, found: Bool, ends: Bool
) -> Float:
    """(2, T) root mean square distance by which edges where the stem ends lie inside the lines."""
    line_px = lines.value[..., None] + lines.slope[..., None] * regions.stations_px
    inside_px = np.maximum(line_px - OUTWARDS * edges_px, 0.0)
    contradicts = ends & found & ~lines.agreeing & (inside_px > 0)
    count = np.maximum(found.sum(2), 1)
    many = contradicts.sum(2) >= MIN_CONTRADICTING_SHARE * count
    squares = np.where(contradicts, inside_px**2, 0.0).sum(2)
    return np.where(many, np.sqrt(squares / count), 0.0)
