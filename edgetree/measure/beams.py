"""Readings of single beams, as of a laser scanner in a camera's picture.

Between the beams nothing is known, and nothing is filled in: each reading keeps its own place. A
stem is read at places in rows across it, as in a depth image, and each of these takes the nearest
beam on the stem. So a beam may stand for several places; its error then counts for all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from edgetree.measure.constants.depth import MIN_BEAMS
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.regions import SearchRegions

# Of more beams on a stem only so many are looked at.
_MAX_BEAMS = 2000
_OUTSIDE_PX = -1.0  # a place in the image that has no reading


class StemBeams(NamedTuple):
    """Beams on T stems, at S stations and N places across each.

    Attributes:
        xy_px: (T, S, N, 2) places of the beams; outside the image for stems with too few.
        places_per_beam: (T,) at how many places each beam is read.
    """

    xy_px: Float
    places_per_beam: Float


def beams_on_stems(
    frame: DepthFrame, regions: SearchRegions, edges_px: Float, within: Float, across: Float
) -> StemBeams:
    """The beam nearest to each place on the stems.

    The stations lie evenly between the lowest and the highest beam.

    Args:
        frame: Depth, camera and masks.
        regions: Search regions.
        edges_px: (2, T, S) left and right edges across the regions.
        within: (T, S) share of the half width in which depth is read.
        across: (N,) places across the stem, from -1 to 1.
    """
    assert frame.beams_px is not None
    count, stations = edges_px.shape[1:]
    found = np.full((count, stations, len(across), 2), _OUTSIDE_PX)
    places_per_beam = np.ones(count)
    on_stem = _on_stem(frame, regions, edges_px, within)
    for index, own in enumerate(on_stem):
        if len(own) < MIN_BEAMS:
            continue
        offset = own - regions.origin_px[index]
        at = np.stack([offset @ regions.along[index], offset @ regions.across[index]], -1)
        nearest = _nearest(regions, index, edges_px[:, index], within[index], across, at)
        found[index] = own[nearest]
        places_per_beam[index] = nearest.size / len(np.unique(nearest))
    return StemBeams(found, places_per_beam)


def _on_stem(
    frame: DepthFrame, regions: SearchRegions, edges_px: Float, within: Float
) -> list[Float]:
    """(M, 2) places of the beams on each stem."""
    assert frame.beams_px is not None
    near = [
        _between_edges(frame.beams_px, regions, index, edges_px[:, index], within[index])
        for index in range(edges_px.shape[1])
    ]
    most = max(map(len, near), default=0)
    padded = np.full((len(near), max(most, 1), 2), _OUTSIDE_PX)
    for row, beams in zip(padded, near, strict=True):
        row[: len(beams)] = beams
    inside = (frame.mask_probability(padded) >= MASK_THRESHOLD) & frame.inside(padded)
    return [beams[row[: len(beams)]] for beams, row in zip(near, inside, strict=True)]


def _between_edges(
    beams_px: Float, regions: SearchRegions, index: int, edges_px: Float, within: Float
) -> Float:
    """(M, 2) beams between the edges (2, S) of one stem; at most `_MAX_BEAMS`, evenly taken."""
    offset = beams_px - regions.origin_px[index]
    along, across = offset @ regions.along[index], offset @ regions.across[index]
    low, high = regions.span_px[index]
    rows = np.flatnonzero((along > low) & (along < high))
    stations = regions.stations_px[index]
    left, right = (np.interp(along[rows], stations, side) for side in edges_px)
    share = np.interp(along[rows], stations, within)
    inner = np.abs(across[rows] - (left + right) / 2) <= share * (right - left) / 2
    rows = rows[inner]
    return beams_px[rows[:: len(rows) // _MAX_BEAMS + 1]]


def _nearest(
    regions: SearchRegions,
    index: int,
    edges_px: Float,
    within: Float,
    across: Float,
    at_px: Float,
) -> Bool:
    """(S, N) numbers of the beams (M, 2; along and across) nearest to the places on one stem."""
    stations, ends = regions.stations_px[index], (at_px[:, 0].min(), at_px[:, 0].max())
    spacing = (ends[1] - ends[0]) / len(stations)
    position = ends[0] + spacing * (np.arange(len(stations)) + 0.5)
    left, right = (np.interp(position, stations, side) for side in edges_px)
    reach = np.interp(position, stations, within) * (right - left) / 2
    places = (left + right)[:, None] / 2 + reach[:, None] * across
    # Distances are taken in places: those along the stem and across it count alike.
    along = (position[:, None] - at_px[:, 0]) / max(spacing, 1e-3)
    step = np.maximum(2 * reach / max(len(across) - 1, 1), 1e-3)
    aside = (places[..., None] - at_px[:, 1]) / step[:, None, None]
    return np.asarray((along[:, None] ** 2 + aside**2).argmin(-1))


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
