"""Diameters along stems, and what follows from them: DBH, taper and volume of the seen part."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.measure.base_ground import BaseGround
from edgetree.measure.constants.outlines import EDGE_ERROR_M, EDGE_SHARE
from edgetree.measure.constants.stems import (
    COLLAR_HEIGHT_DIAMETERS,
    COLLAR_STD,
    LOWEST_HEIGHT_DIAMETERS,
    LOWEST_HEIGHT_M,
    MAX_RELATIVE_STD,
    MIN_SHAPE,
    MIN_TAPER_M,
    SHAPE_STDS,
    SWELL_LENGTH_M,
    TAPER_PER_M,
    TAPER_SPREAD_PER_M,
)
from edgetree.measure.estimates import Estimate, Failure
from edgetree.measure.profile import StemProfile
from edgetree.measure.stem_fit import Stems
from edgetree.measure.width import MaskWidths, StemEdges

# Distance between the diameters of a profile, in m, and their largest number.
_STEP_M, _MAX_DIAMETERS = 0.1, 300


class Taper(NamedTuple):
    """What the diameters along one stem tell, as in `TreeMeasurement`."""

    dbh_m: Estimate | Failure
    profile: StemProfile | Failure
    taper_cm_per_m: Estimate | Failure
    seen_volume_m3: Estimate | Failure

    def seen_part(self, section: Estimate) -> Estimate:
        """The diameter at breast height, or in the middle of the part that is seen.

        Without a height, it has the spread of the diameters along that part, too.

        Args:
            section: The diameter at the lowest part, whose relative error is the least.
        """
        seen = self.dbh_m
        if not isinstance(seen, Estimate):
            if not isinstance(self.profile, StemProfile):
                return section
            middle = len(self.profile.height_m) // 2
            along_m = self.profile.diameter_m
            std_m = math.hypot(float(self.profile.diameter_std_m[middle]), float(along_m.std()))
            section = Estimate(section.value, math.hypot(section.std, float(along_m.std())))
            seen = Estimate(float(along_m[middle]), std_m)
        return Estimate(seen.value, max(seen.std, section.std / section.value * seen.value))


class HeightScale(NamedTuple):
    """Heights along the axes of T stems.

    Attributes:
        zero_m: (T,) position of height 0 along the axis, from the section.
        per_m: (T,) metres along the axis per metre of height.
        from_ground: (T,) whether heights are above the ground on the uphill side. The others are
            along the axis from the section.
    """

    zero_m: Float
    per_m: Float
    from_ground: Bool


def height_scale(stems: Stems, cuts: Float, grounds: Sequence[BaseGround | Failure]) -> HeightScale:
    """Heights above the ground along the axes, or from the section without a ground.

    Args:
        stems: T stems.
        cuts: (T, 3) axis points at the felling cuts.
        grounds: Ground at each stem.
    """
    sections = stems.sections
    zero_m, per_m = np.zeros(len(cuts)), np.ones(len(cuts))
    section_m = stems.distance_m * sections.height_ratio
    cut_to_section_m = section_m - np.vecdot(cuts, sections.axes.along)
    for index, ground in enumerate(grounds):
        if isinstance(ground, BaseGround):
            along, radius_m = sections.axes.along[index], float(stems.radius_m[index])
            above_m = ground.axis_length_m(cuts[index], along, radius_m, 0.0)
            zero_m[index] = above_m - cut_to_section_m[index]
            per_m[index] = ground.axis_per_height(along)
    known = np.array([isinstance(ground, BaseGround) for ground in grounds])
    return HeightScale(zero_m, per_m, known)


@dataclass(frozen=True, eq=False, kw_only=True)
class StemDiameters:
    """N diameters along T stems, sorted by stem and height.

    Attributes:
        heights: Heights along the axes.
        stem: (N,) number of the stem.
        height_m: (N,) heights.
        along_m: (N,) positions along the axis, from the section.
        value_m: (N,) diameters.
        std_m: (N,) their standard deviations.
        edge_std_m: (N,) the part of these from the edges and the shape of the stem.
        collar_std_m: (N,) the part from the root collar.
        tilt_std: (T,) relative error of a diameter per metre from the section, from the axis' tilt.
        edges_m: (N, 2, 3) camera points at the left and the right edge.
        breast: Diameter at breast height of each stem; None if the edges do not show there.
    """

    heights: HeightScale
    stem: Index
    height_m: Float
    along_m: Float
    value_m: Float
    std_m: Float
    edge_std_m: Float
    collar_std_m: Float
    tilt_std: Float
    edges_m: Float
    breast: list[Estimate | None]

    def _sums(self, values: Float) -> Float:
        """(T,) sums over the diameters of each stem."""
        return np.asarray(np.bincount(self.stem, values, len(self.tilt_std)), np.float64)

    def profiles(self) -> list[StemProfile | Failure]:
        """The diameters of each stem."""
        ends = np.searchsorted(self.stem, np.arange(len(self.tilt_std) + 1))
        return [
            StemProfile(
                heights_from="ground" if self.heights.from_ground[index] else "section",
                height_m=self.height_m[first:last],
                diameter_m=self.value_m[first:last],
                diameter_std_m=self.std_m[first:last],
                edges_m=self.edges_m[first:last],
            )
            if last - first > 1
            else _UNSEEN
            for index, (first, last) in enumerate(pairwise(ends))
        ]

    def volumes_m3(self) -> list[Estimate | Failure]:
        """Volume of each stem between its lowest and its highest diameter, of truncated cones.

        The errors of the diameters have mostly the same causes. They are taken as fully
        correlated, so the relative error of a volume is twice that of the diameters. Only that by
        the root collar is independent of the others.
        """
        same = self.stem[1:] == self.stem[:-1]
        length_m = np.where(same, np.diff(self.along_m), 0.0)
        low, high = self.value_m[:-1], self.value_m[1:]
        cones = math.pi / 12 * length_m * (low**2 + low * high + high**2)
        count = len(self.tilt_std)
        parts = []
        for std_m in (np.sqrt(self.std_m**2 - self.collar_std_m**2), self.collar_std_m):
            spread = math.pi / 4 * self.value_m * std_m
            errors = length_m * (spread[:-1] + spread[1:])
            parts.append(np.bincount(self.stem[1:], errors, count))
        values = np.bincount(self.stem[1:], cones, count).tolist()
        return [
            Estimate(value, std) if value > 0 else _UNSEEN
            for value, std in zip(values, np.hypot(*parts).tolist(), strict=True)
        ]

    def tapers_cm_per_m(self) -> list[Estimate | Failure]:
        """Decrease of the diameter along each stem, by a straight line fitted to the diameters.

        Errors that all diameters of a stem share do not change it. The edges have independent
        errors only at distances of `EDGE_ERROR_M`.
        """
        number = np.maximum(self._sums(np.ones(len(self.stem))), 1.0)
        offset = self.along_m - (self._sums(self.along_m) / number)[self.stem]
        square = np.maximum(self._sums(offset**2), 1e-9)
        slope = self._sums(offset * self.value_m) / square
        seen_m = np.zeros(len(number))
        np.maximum.at(seen_m, self.stem, 2 * np.abs(offset))
        independent = (1 + seen_m / EDGE_ERROR_M) * square / number
        edges = self._sums(self.edge_std_m) / number / np.sqrt(independent)
        std = np.hypot(edges, self._sums(self.value_m) / number * self.tilt_std)
        return [
            Estimate(-100 * value, 100 * error)
            if length_m >= MIN_TAPER_M
            else Failure(
                f"the taper needs {MIN_TAPER_M:g} m of the stem: {length_m:.1f} m are seen"
            )
            for value, error, length_m in zip(
                slope.tolist(), std.tolist(), seen_m.tolist(), strict=True
            )
        ]


_UNSEEN = Failure("both edges of the stem are seen at hardly any height")


def read_diameters(
    stems: Stems,
    widths: MaskWidths,
    edges: StemEdges,
    heights: HeightScale,
    *,
    shared_std: Float,
    shape_std: float,
    breast_height_m: float,
) -> StemDiameters:
    """Read diameters at every 10 cm along T stems where both edges show, and at breast height.

    1. List the heights: steps of 10 cm between the ends of the edges, then breast heights.
    2. Read the half angle at each from the mask edges around it, which makes a diameter.
    3. Add up its errors: edges and shape, what all diameters of a stem share, the tilt of the axis
       over the distance from the section, and the root collar.
    4. Keep those where both edges show, above the collar, and that are certain enough.

    Args:
        stems: The fitted stems.
        widths: Mask edges by height.
        edges: The same as rays, with the swell of the butt.
        heights: Heights along the axes.
        shared_std: (T,) relative standard deviation that all diameters of a stem share.
        shape_std: Relative standard deviation of a diameter from the shape of the stem.
        breast_height_m: Breast height.
    """
    count = len(shared_std)
    rows, height_m = _steps(widths, heights)
    # The last T diameters are at breast height.
    rows = np.concatenate([rows, np.arange(count)])
    height_m = np.concatenate([height_m, np.full(count, breast_height_m)])
    along_m = heights.zero_m[rows] + height_m * heights.per_m[rows]
    picked = widths.select(rows)
    half, middle_rad = picked.at(along_m)
    value_m = 2 * stems.distance_m[rows] * np.sin(half.rad)
    tilt_std = stems.tilt_std_rad / stems.distance_m
    edge_std_m = value_m * np.hypot(EDGE_SHARE * half.std_rad / np.tan(half.rad), shape_std)
    visible = picked.visible_at(along_m)
    shape_doubt = _beyond_shape(stems, edges, rows, along_m, value_m, edge_std_m, visible)
    edge_std_m = np.hypot(edge_std_m, shape_doubt * value_m)
    other_std = np.hypot(shared_std[rows], tilt_std[rows] * along_m)
    collar_std, above_collar = _root_collar(heights.from_ground[rows], height_m, value_m)
    collar_std_m = value_m * collar_std
    std_m = np.hypot(np.hypot(edge_std_m, value_m * other_std), collar_std_m)
    seen = visible & (std_m <= MAX_RELATIVE_STD * value_m) & above_collar
    breast = [
        Estimate(value, std) if visible else None
        for value, std, visible in zip(
            value_m[-count:].tolist(), std_m[-count:].tolist(), seen[-count:].tolist(), strict=True
        )
    ]
    kept = np.flatnonzero(seen[:-count])
    edges_m = _edges_m(stems, rows[kept], along_m[kept], half.rad[kept], middle_rad[kept])
    return StemDiameters(
        heights=heights,
        stem=rows[kept],
        height_m=height_m[kept],
        along_m=along_m[kept],
        value_m=value_m[kept],
        std_m=std_m[kept],
        edge_std_m=edge_std_m[kept],
        collar_std_m=collar_std_m[kept],
        tilt_std=tilt_std,
        edges_m=edges_m,
        breast=breast,
    )


def _steps(widths: MaskWidths, heights: HeightScale) -> tuple[Index, Float]:
    """(N,) numbers of stems, and heights in steps of 10 cm between the ends of their edges."""
    low = np.where(widths.valid, widths.height_m, np.inf).min(2).max(0)
    high = np.where(widths.valid, widths.height_m, -np.inf).max(2).min(0)
    first = np.ceil((low - heights.zero_m) / heights.per_m / _STEP_M)
    first = np.where(heights.from_ground, np.maximum(first, 0.0), first)
    last = np.floor((high - heights.zero_m) / heights.per_m / _STEP_M)
    known = np.isfinite(first) & np.isfinite(last)
    number = np.where(known, np.clip(last - first + 1, 0, _MAX_DIAMETERS), 0).astype(np.intp)
    rows = np.repeat(np.arange(len(number)), number)
    within = np.arange(len(rows)) - np.repeat(np.cumsum(number) - number, number)
    return rows, (first[rows] + within) * _STEP_M


def _beyond_shape(
    stems: Stems,
    edges: StemEdges,
    rows: Index,
    along_m: Float,
    value_m: Float,
    std_m: Float,
    visible: Bool,
) -> Float:
    """By how much diameters differ from what a tapering stem with that section has.

    Arms of a fork, branches and a nearer stem that hides an edge change the width of a mask. What a
    difference shows beyond `SHAPE_STDS` standard deviations counts as one, as in Birge's ratio. It
    is that to the section, or that to the thinnest place below: stems do not get thicker upwards.

    Args:
        stems: The fitted stems.
        edges: Their edges, with the swell of the butt.
        rows: (N,) numbers of the stems.
        along_m: (N,) positions along the axes, from the section.
        value_m: (N,) diameters.
        std_m: (N,) their standard deviations by edges and shape.
        visible: (N,) whether both edges show there.

    Returns:
        (N,) relative standard deviations.
    """
    above_swell = 1 - np.exp(-np.maximum(along_m, 0.0) / SWELL_LENGTH_M)
    expected = 1 - edges.butt_swell[rows] * above_swell - TAPER_PER_M * along_m
    expected = np.maximum(expected, MIN_SHAPE)
    section_std = stems.half_std_rad / np.tan(stems.sections.half_rad)
    taper_std = TAPER_SPREAD_PER_M * along_m
    swell_std = edges.butt_swell_std[rows] * above_swell
    stds = [section_std[rows] * expected, taper_std, swell_std, std_m / value_m * expected]
    off = value_m / (2 * stems.radius_m[rows]) - expected
    beyond = np.maximum(off**2 - SHAPE_STDS**2 * np.square(stds).sum(0), 0.0) / expected**2
    size = value_m / expected
    lowest = _thinnest_below(rows, along_m, np.where(visible, size, np.inf))
    grown = size / size[lowest] - 1
    edge_std = std_m / value_m
    taper_std = TAPER_SPREAD_PER_M * (along_m - along_m[lowest])
    variance = edge_std**2 + edge_std[lowest] ** 2 + taper_std**2
    grown = np.maximum(grown**2 - SHAPE_STDS**2 * variance, 0.0)
    return np.asarray(np.sqrt(np.maximum(beyond, grown)))


def _thinnest_below(rows: Index, along_m: Float, size_m: Float) -> Index:
    """(N,) number of the smallest of the sizes of the same stem from there down.

    Those that are not known are infinite.
    """
    order = np.lexsort((along_m, rows))
    # Each stem's sizes are below all of those of the stems before it.
    highest_m = 1 + size_m[np.isfinite(size_m)].max(initial=0.0)
    shifted = np.minimum(size_m[order], highest_m) - 2 * rows[order] * highest_m
    is_least = shifted <= np.minimum.accumulate(shifted)
    least = np.maximum.accumulate(np.where(is_least, np.arange(len(order)), 0))
    found = np.empty_like(order)
    found[order] = order[least]
    return found


def _root_collar(from_ground: Bool, height_m: Float, diameter_m: Float) -> tuple[Float, Bool]:
    """Errors by the root collar.

    Args:
        from_ground: (N,) whether the heights are above the ground.
        height_m: (N,) heights.
        diameter_m: (N,) diameters.

    Returns:
        (N,) relative standard deviations, and (N,) which heights are above the collar.
    """
    height = height_m / diameter_m
    above = (height >= LOWEST_HEIGHT_DIAMETERS) & (height_m > LOWEST_HEIGHT_M - _STEP_M / 2)
    std = COLLAR_STD * np.exp(-height / COLLAR_HEIGHT_DIAMETERS)
    return np.where(from_ground, std, 0.0), ~from_ground | above


def _edges_m(
    stems: Stems, rows: Index, along_m: Float, half_rad: Float, middle_rad: Float
) -> Float:
    """(N, 2, 3) camera points at which the left and the right viewing ray touch the stem."""
    axes, distance_m = stems.sections.axes, stems.distance_m[rows]
    along, across, away = axes.along[rows], axes.across[rows], axes.away[rows]
    level_m = distance_m * stems.sections.height_ratio[rows] + along_m
    reach_m = distance_m * np.cos(half_rad)
    bearing = (middle_rad[:, None] + np.outer(half_rad, (-1, 1)))[..., None]
    flat = np.cos(bearing) * away[:, None] + np.sin(bearing) * across[:, None]
    return np.asarray(reach_m[:, None, None] * flat + (level_m[:, None] * along)[:, None])
