"""Tell the depth of stems from that of things in front of them, which go on beyond their edges."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.measure.beams import beams_go_on
from edgetree.measure.constants.depth import (
    BESIDE_SHARE,
    FILLED_SHARE,
    MIN_OWN_SHARE,
    MIN_OWN_STATIONS,
    SEEN_THROUGH_SHARE,
    SURFACE_M,
    SURFACE_STDS,
)
from edgetree.measure.edge_lines import fit_lines, masked_medians
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.regions import OUTWARDS, SearchRegions

# The depth beside a stem is read at these distances from its middle, in half widths, and at least
# so far from its edge.
_BESIDE = np.array([1.3, 1.7])
_MIN_BESIDE_PX = 3.0
# Rounds of the line through the stem's own readings, by least absolute differences.
_ROUNDS = 3
# The masks of other trees are looked for at these distances to both sides of a reading, in sizes of
# the window of the depth camera.
_GROWN = np.array([-1.0, -0.5, 0.5, 1.0])


def goes_on_beside(
    frame: DepthFrame, regions: SearchRegions, edges_px: Float, depth_m: Float
) -> tuple[Bool, Bool]:
    """Whether readings within the edges are of a surface that also shows beside the stem.

    A stem's surface ends at its edges. Branches, netting and brush cross them at the same depth.
    Each reading is compared with those beside the stem at its own and the two next stations, on
    each side by itself. It goes on if `BESIDE_SHARE` of one side are as far away, within the noise
    and `SURFACE_M`.

    Args:
        frame: Depth, camera and settings.
        regions: Search regions.
        edges_px: (2, T, S) left and right edges across the regions.
        depth_m: (T, S, N) readings at the stations; 0 where there is none.

    Returns:
        (T, S, N) flags, and (T,) whether the mask of another tree is beside the stem.
    """
    middle, reach = edges_px.sum(0) / 2, (edges_px[1] - edges_px[0]) / 2
    apart = np.maximum(_BESIDE * reach[..., None], reach[..., None] + _MIN_BESIDE_PX)
    xy_px = regions.points(middle[..., None] + OUTWARDS[..., None] * apart)
    on_other = _on_any_stem(frame, xy_px)
    read_m = frame.depth_at(xy_px)
    stations = depth_m.shape[1]
    beside_m = np.full((*read_m.shape[:2], stations + 2, len(_BESIDE)), np.inf)
    beside_m[:, :, 1:-1] = np.where(on_other | (read_m == 0), np.inf, read_m)
    # The places come first, as sums over the first axis are fast.
    near = np.stack([beside_m[:, :, first : first + stations] for first in range(3)])
    near = np.moveaxis(near, -1, 1).reshape(-1, *edges_px.shape, 1)
    alike = np.abs(near - depth_m) < _noise_m(frame, depth_m)
    share = alike.sum(0).max(0) / len(near)
    return (depth_m > 0) & (share >= BESIDE_SHARE), np.asarray(on_other.any((0, 2, 3)))


def _grown(frame: DepthFrame, rows: Index, across: Float, xy_px: Float, depth_m: Float) -> Bool:
    """Whether readings may be of another tree, whose depth has grown beyond its mask.

    Stereo cameras and filters give the pixels around a near stem its depth, up to about the size
    of their window (`MeasureSettings.depth_correlation_px`).

    Args:
        frame: Depth, masks and settings.
        rows: (T,) numbers of the stems among the frame's trees.
        across: (T, 2) unit vectors across the stems.
        xy_px: (T, S, N, 2) places of the readings.
        depth_m: (T, S, N) readings; 0 where there is none.

    Returns:
        (T, S, N) flags: the mask of another tree is so near, and as far away, within the noise and
        `SURFACE_M`.
    """
    away_px = frame.settings.depth_correlation_px * _GROWN[:, None, None, None, None]
    beside_px = xy_px + away_px * across[:, None, None]
    own_masks = replace(frame, masks=[(frame.masks or [])[row] for row in rows.tolist()])
    own = own_masks.mask_probability(beside_px.swapaxes(0, 1)).swapaxes(0, 1) >= MASK_THRESHOLD
    # Few places are left to read the depth, and to look for other masks at.
    left = np.nonzero((depth_m > 0) & ~own)
    places_px, there_m = beside_px[left], depth_m[left[1:]]
    alike = np.abs(frame.depth_at(places_px) - there_m) < _noise_m(frame, there_m)
    alike[alike] = frame.on_any_stem(places_px[alike][None])[0]
    grown = np.zeros_like(own)
    grown[left] = alike
    return np.asarray(grown.any(0))


class OwnReadings(NamedTuple):
    """Readings without those of things in front of T stems.

    Attributes:
        depth_m: (T, S, N) readings; 0 where there is none.
        plausible: (T,) whether they can be the stem's.
        doubtful: (T,) whether nearly all of them go on beside the stem, so that they may as well be
            of something that stands before it.
    """

    depth_m: Float
    plausible: Bool
    doubtful: Bool


def own_readings(
    frame: DepthFrame,
    regions: SearchRegions,
    edges_px: Float,
    depth_m: Float,
    on_stem: Bool,
    xy_px: Float | None,
) -> OwnReadings:
    """Leave out readings of things in front, as far as the stem has enough of its own.

    Those that may be of another tree beside the stem are none of its own, see `_grown`.

    The readings that do not go on beside the stem give a line of inverse depth along it. Others
    that are nearer than this line are left out. Where there are too few, all stay: a stem in a
    thicket is as far away as what is beside it. Then they have to fill the outline, because a
    branch or a twig does not, and nothing may show behind them, because nothing is seen through a
    stem.

    Args:
        frame: Depth, camera and settings.
        regions: Search regions.
        edges_px: (2, T, S) left and right edges across the regions.
        depth_m: (T, S, N) readings at the stations; 0 where there is none.
        on_stem: (T, S, N) places within the masks.
        xy_px: (T, S, N, 2) their places in the image. None leaves those that have grown from
            another tree, for lines that a few of them do not move.
    """
    if not frame.is_sparse:
        goes_on, touched = goes_on_beside(frame, regions, edges_px, depth_m)
        rows = np.flatnonzero(touched)
        if len(rows) and xy_px is not None:
            grown = _grown(frame, rows, regions.across[rows], xy_px[rows], depth_m[rows])
            depth_m = depth_m.copy()
            depth_m[rows] = np.where(grown, 0.0, depth_m[rows])
            goes_on &= depth_m > 0
    else:
        beams = np.concatenate([xy_px, depth_m[..., None]], -1)
        goes_on = beams_go_on(frame, regions, edges_px, beams, _noise_m(frame, depth_m))
    own = (depth_m > 0) & ~goes_on
    places = np.maximum(on_stem.sum((1, 2)), 1)
    along = own.any(2).sum(1) / np.maximum(on_stem.any(2).sum(1), 1)
    enough = (own.sum((1, 2)) >= MIN_OWN_SHARE * places) & (along >= MIN_OWN_STATIONS)
    half_px = (edges_px[1] - edges_px[0])[..., None] / 2
    nearer = np.zeros_like(goes_on)
    rows = np.flatnonzero(goes_on.any((1, 2)) & enough)
    if len(rows):
        front_m = _front_m(regions.stations_px[rows], depth_m[rows], own[rows])[..., None]
        within_m = half_px[rows] * front_m / frame.camera.fx + _noise_m(frame, front_m)
        nearer[rows] = goes_on[rows] & (depth_m[rows] < front_m - within_m)
    fills = (not frame.is_sparse) & ((depth_m > 0).sum((1, 2)) >= FILLED_SHARE * places)
    doubtful = ~enough & fills
    plausible = enough | doubtful
    if doubtful.any():
        seen = _seen_through(frame, depth_m, own, goes_on, half_px)
        plausible &= enough | (seen < SEEN_THROUGH_SHARE * places)
    return OwnReadings(np.where(nearer, 0.0, depth_m), plausible, doubtful)


def _seen_through(
    frame: DepthFrame, depth_m: Float, own: Bool, goes_on: Bool, half_px: Float
) -> Float:
    """(T,) how many of the stems' own readings lie behind those that go on beside them."""
    count = len(depth_m)
    near_m = masked_medians(depth_m.reshape(count, -1), goes_on.reshape(count, -1))
    near_m = np.where(near_m > 0, near_m, np.inf)[:, None, None]
    behind_m = half_px * near_m / frame.camera.fx + _noise_m(frame, near_m)
    return np.asarray((own & (depth_m > near_m + behind_m)).sum((1, 2)))


def _front_m(stations_px: Float, depth_m: Float, own: Bool) -> Float:
    """(T, S) depths by a straight line of inverse depth through the stem's own readings."""
    position = np.broadcast_to(stations_px[..., None], own.shape).reshape(len(own), -1)
    inverse = np.where(own, 1 / np.where(own, depth_m, 1.0), 0.0).reshape(position.shape)
    weight = own.reshape(position.shape).astype(np.float64)
    line = np.zeros_like(position)
    for _ in range(_ROUNDS):
        value, slope = fit_lines(position, inverse, weight)
        line = value[:, None] + slope[:, None] * position
        off = np.abs(inverse - line)
        middle = masked_medians(off, own.reshape(position.shape))[:, None]
        weight = own.reshape(position.shape) / np.maximum(off, middle + 1e-6)
    front = line.reshape(own.shape)[..., 0]
    return np.asarray(1 / np.maximum(front, 1e-3))


def _noise_m(frame: DepthFrame, depth_m: Float) -> Float:
    """By how much readings (...) of one surface may differ."""
    return np.asarray(SURFACE_STDS * frame.settings.depth_stds_m(depth_m) + SURFACE_M)


def _on_any_stem(frame: DepthFrame, xy_px: Float) -> Bool:
    """(2, T, S, N) whether the points are on the mask of any tree."""
    flat = frame.on_any_stem(xy_px.reshape(1, -1, 2))
    return np.asarray(flat.reshape(xy_px.shape[:-1]))
