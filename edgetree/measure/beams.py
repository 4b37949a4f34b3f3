"""Readings of single beams, as of a laser scanner in a camera's picture.

Between the beams nothing is known, and nothing is filled in: each reading keeps its own place. A
stem is read at places in rows across it, as in a depth image, and each of these takes the nearest
beam on the stem. So a beam may stand for several places; its error then counts for all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.measure.constants.depth import MIN_BEAMS
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.regions import SearchRegions, line_spans

# Of more beams on a stem only so many are looked at.
_MAX_BEAMS = 2000
# Beams beside a stem are compared with its own between these distances from its edge, the second
# one beyond half its width, and if they are level within the third.
_MIN_BESIDE_PX, _MAX_BESIDE_PX, _LEVEL_PX = 1.5, 12.0, 3.0
_OUTSIDE_PX = -1.0  # a place in the image that has no reading


class StemBeams(NamedTuple):
    """Beams on T stems, at S stations and N places across each.

    Attributes:
        xy_px: (T, S, N, 2) places of the beams; the places themselves of stems with too few.
        places_per_beam: (T,) at how many places each beam is read.
        enough: (T,) whether there are enough of them.
    """

    xy_px: Float
    places_per_beam: Float
    enough: Bool


def beams_on_stems(
    frame: DepthFrame,
    regions: SearchRegions,
    edges_px: Float,
    within: Float,
    across: Float,
    places_px: Float,
) -> StemBeams:
    """The beam nearest to each place on the stems.

    The stations lie evenly between the lowest and the highest beam.

    Args:
        frame: Depth, camera and masks.
        regions: Search regions.
        edges_px: (2, T, S) left and right edges across the regions.
        within: (T, S) share of the half width in which depth is read.
        across: (N,) places across the stem, from -1 to 1.
        places_px: (T, S, N, 2) the places in the image.
    """
    found = places_px.copy()
    places_per_beam, enough = np.ones(len(found)), np.zeros(len(found), np.bool_)
    on_stem = _on_stem(frame, regions, edges_px, within)
    for index, own in enumerate(on_stem):
        if len(own) < MIN_BEAMS:
            continue
        at = np.stack(_in_region(own, regions, index), -1)
        nearest = _nearest(regions, index, edges_px[:, index], within[index], across, at)
        found[index], enough[index] = own[nearest], True
        places_per_beam[index] = nearest.size / len(np.unique(nearest))
    return StemBeams(found, places_per_beam, enough)


def _on_stem(
    frame: DepthFrame, regions: SearchRegions, edges_px: Float, within: Float
) -> list[Float]:
    """(M, 2) places of the beams on each stem."""
    near = [
        _between_edges(frame, regions, index, edges_px[:, index], within[index])
        for index in range(edges_px.shape[1])
    ]
    most = max(map(len, near), default=0)
    padded = np.full((len(near), max(most, 1), 2), _OUTSIDE_PX)
    for row, beams in zip(padded, near, strict=True):
        row[: len(beams)] = beams
    inside = (frame.mask_probability(padded) >= MASK_THRESHOLD) & frame.inside(padded)
    return [beams[row[: len(beams)]] for beams, row in zip(near, inside, strict=True)]


def _between_edges(
    frame: DepthFrame, regions: SearchRegions, index: int, edges_px: Float, within: Float
) -> Float:
    """(M, 2) beams between the edges (2, S) of one stem; at most `_MAX_BEAMS`, evenly taken."""
    assert frame.beams_px is not None
    along, across = _in_region(frame.beams_px, regions, index)
    low, high = regions.span_px[index]
    if frame.masks:
        # A region may be shorter than its mask, whose other beams tell the distance too.
        box = frame.masks[index].box_px[None]
        axis = (regions.origin_px[index, None], regions.along[index, None])
        low, high = line_spans(*axis, box)[0]
    rows = np.flatnonzero((along > low) & (along < high))
    middle, reach = _middle_and_reach(regions, index, edges_px, along[rows])
    share = np.interp(along[rows], regions.stations_px[index], within)
    rows = rows[np.abs(across[rows] - middle) <= share * reach]
    return frame.beams_px[rows[:: len(rows) // _MAX_BEAMS + 1]]


def _in_region(xy_px: Float, regions: SearchRegions, index: int) -> tuple[Float, Float]:
    """Positions (M,) of points (M, 2) along and across one region."""
    offset = xy_px - regions.origin_px[index]
    return offset @ regions.along[index], offset @ regions.across[index]


def _middle_and_reach(
    regions: SearchRegions, index: int, edges_px: Float, along: Float
) -> tuple[Float, Float]:
    """Middle and half width of one stem at positions along it; its edges are straight lines."""
    first, last = regions.stations_px[index, [0, -1]]
    share = (along - first) / (last - first)
    left, right = (side[0] + share * (side[-1] - side[0]) for side in edges_px)
    return (left + right) / 2, (right - left) / 2


def _nearest(
    regions: SearchRegions,
    index: int,
    edges_px: Float,
    within: Float,
    across: Float,
    at_px: Float,
) -> Index:
    """(S, N) numbers of the beams (M, 2; along and across) nearest to the places on one stem."""
    stations, ends = regions.stations_px[index], (at_px[:, 0].min(), at_px[:, 0].max())
    spacing = (ends[1] - ends[0]) / len(stations)
    position = ends[0] + spacing * (np.arange(len(stations)) + 0.5)
    middle, reach = _middle_and_reach(regions, index, edges_px, position)
    reach = np.maximum(np.interp(position, stations, within) * reach, 0.0)
    places = middle[:, None] + reach[:, None] * across
    # Distances are taken in places: those along the stem and across it count alike.
    along = (position[:, None] - at_px[:, 0]) / max(spacing, 1e-3)
    step = np.maximum(2 * reach / max(len(across) - 1, 1), 1e-3)
    aside = (places[..., None] - at_px[:, 1]) / step[:, None, None]
    return np.asarray((along[:, None] ** 2 + aside**2).argmin(-1))


def beams_go_on(
    frame: DepthFrame, regions: SearchRegions, edges_px: Float, depth_m: Float, within_m: Float
) -> Bool:
    """Whether beams on T stems are of a surface that also shows beside the stem.

    Each is compared with the beams beside the stem at its own height, on each side by itself: a
    surface goes on if half of those of one side are as far away.

    Args:
        frame: Depth, camera and masks.
        regions: Search regions.
        edges_px: (2, T, S) left and right edges across the regions.
        depth_m: (T, S, N, 3) places of beams in the image, and their depth; 0 for none.
        within_m: (T, S, N) by how much readings of one surface may differ.

    Returns:
        (T, S, N) flags.
    """
    assert frame.beams_px is not None
    goes_on = np.zeros(within_m.shape, np.bool_)
    outside_px = frame.beams_px[~frame.on_any_stem(frame.beams_px[None])[0]]
    outside_m = frame.depth_at(outside_px)
    for index, (beams, within) in enumerate(zip(depth_m, within_m, strict=True)):
        along, across = _in_region(outside_px, regions, index)
        middle, reach = _middle_and_reach(regions, index, edges_px[:, index], along)
        aside = np.abs(across - middle) - reach
        near = (aside > _MIN_BESIDE_PX) & (aside < np.maximum(reach, 0.0) + _MAX_BESIDE_PX)
        own, _ = _in_region(beams[..., :2].reshape(-1, 2), regions, index)
        level = np.abs(own[:, None] - along[near]) < _LEVEL_PX
        apart_m = np.abs(beams[..., 2].reshape(-1, 1) - outside_m[near])
        alike = level & (apart_m < within.reshape(-1, 1))
        for side in (across[near] < middle[near], across[near] > middle[near]):
            many = 2 * (alike & side).sum(1) >= np.maximum((level & side).sum(1), 1)
            goes_on[index] |= many.reshape(goes_on.shape[1:])
    return np.asarray(goes_on & (depth_m[..., 2] > 0))


def beams_within(frame: DepthFrame, low_px: Float, high_px: Float, most: int) -> Float:
    """(T, most, 2) places of the beams in each of T boxes, evenly taken; the rest is outside.

    Args:
        frame: A frame of beams.
        low_px, high_px: (T, 2) corners of the boxes.
        most: Number of places.
    """
    assert frame.beams_px is not None
    found = np.full((len(low_px), most, 2), _OUTSIDE_PX)
    for row, low, high in zip(found, low_px, high_px, strict=True):
        here = np.flatnonzero(((frame.beams_px > low) & (frame.beams_px < high)).all(1))
        here = here[:: len(here) // most + 1]
        row[: len(here)] = frame.beams_px[here]
    return found
