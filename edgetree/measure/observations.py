"""Collect what a frame shows of its stems: keypoints, outlines and depth readings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from calib.directions import lengths, unit
from edgetree.measure.beams import beams_on_stems
from edgetree.measure.constants.depth import DEPTH_WITHIN, MIN_OWN_SHARE
from edgetree.measure.constants.outlines import SECTION_QUANTILE, STATIONS_PER_ERROR
from edgetree.measure.constants.stems import STEM_BEND_PER_M
from edgetree.measure.edge_lines import fit_lines, masked_medians, pick
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.keypoints import CUT, LEFT, MIDDLE, RIGHT, TOP, Keypoints
from edgetree.measure.layers import own_readings
from edgetree.measure.outline import Outline, trace_outline
from edgetree.measure.regions import OUTWARDS, STATIONS, SearchRegions
from edgetree.measure.search_regions import find_regions
from edgetree.measure.second_stem import SecondStems
from edgetree.measure.stem_fit import Readings
from edgetree.measure.straight_part import StraightParts
from edgetree.measure.width import StemEdges

# Depth is sampled at this many points across the stem.
_DEPTH_SAMPLES = 9
_ACROSS = np.linspace(-1, 1, _DEPTH_SAMPLES)
# Of depth that is smoothed over most of the stem, at least this share of the half width is read.
_MIN_WITHIN = 0.2
# A midpoint between the mask's edges this far off the centre line, in half widths, is not used.
_MAX_OFF_CENTRE = 0.35


@dataclass(frozen=True, eq=False, kw_only=True)
class StemObservations:
    """Everything a frame shows of T stems.

    Attributes:
        outline: Edges in the masks; None if there are no masks.
        edges: Edges as viewing rays.
        axis_rays: (T, N, 3) viewing rays to points on the axes.
        axis_std_rad: (T, N) standard deviations of their angles; infinite for rays to ignore.
        readings: Depth readings within the outlines.
        on_stem_fraction: (T,) fraction of the depth samples that are on the stem's mask.
        valid_depth_fraction: (T,) fraction of these that have a depth reading, without those of
            things in front.
        plausible_depth: (T,) whether these readings can be the stem's, see `OwnReadings`.
        doubtful_depth: (T,) whether they may be of something in front.
        straight: Which masks are cut to the straight part of their stem, if that was looked at.
        second: Which masks hold a second stem, if that is known.
    """

    outline: Outline | None
    edges: StemEdges
    axis_rays: Float
    axis_std_rad: Float
    readings: Readings
    on_stem_fraction: Float
    valid_depth_fraction: Float
    plausible_depth: Bool
    doubtful_depth: Bool
    straight: StraightParts | None = None
    second: SecondStems | None = None

    @property
    def above_foot(self) -> Bool:
        """(T,) whether what is left of a mask ends above the foot of its stem."""
        if self.straight is None:
            return np.zeros(len(self.plausible_depth), np.bool_)
        return self.straight.above_foot

    def foot_within(self, keypoints: Keypoints) -> Bool:
        """(T,) whether the foot is in the image and on the mask, as far as one can tell."""
        cut_off = keypoints.reaches_lower_side | self.above_foot
        return np.asarray(keypoints.within[:, CUT] | ~cut_off)

    def enough_used(self, used: Index) -> Bool:
        """(T,) whether `used` (T,) readings are enough of the places on the stems."""
        places = self.on_stem_fraction * self.readings.depth_m.shape[1]
        return np.asarray(used >= MIN_OWN_SHARE * places)


def observe_stems(frame: DepthFrame, boxes_px: Float, keypoints: Keypoints) -> StemObservations:
    """Collect outlines, edges, axis points and depth readings of all stems.

    1. Lay a straight search region along each stem.
    2. Find the stem's edges in its mask, and straight lines along them.
    3. Sample the depth between these lines. It tells how far the stem is.
    4. Make viewing rays of the edges and of the section of the diameter.
    5. Make viewing rays to points on the axis, each with its error.

    Args:
        frame: Depth, masks and camera.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.
        keypoints: Keypoints of the same trees.
    """
    regions = find_regions(frame, boxes_px, keypoints)
    outline = None
    if frame.masks is not None:
        outline = trace_outline(frame, regions, keypoints)
        regions = outline.regions
    depth = _sample_depth(frame, regions, outline)
    if outline is not None:
        outline = outline.without_occluded_edges(frame, depth.median_m)
    edges = _edges(frame, regions, outline, keypoints, depth.median_m)
    rays, std_rad = _axis_rays(frame, regions, edges, keypoints)
    return StemObservations(
        outline=outline,
        edges=edges,
        axis_rays=rays,
        axis_std_rad=std_rad,
        readings=depth.readings,
        on_stem_fraction=depth.on_stem_fraction,
        valid_depth_fraction=depth.valid_fraction,
        plausible_depth=depth.plausible,
        doubtful_depth=depth.doubtful,
    )


class _DepthSamples(NamedTuple):
    """Depth samples on T stems.

    Attributes:
        readings: The samples as readings.
        on_stem_fraction: (T,) fraction of the samples on the stem's mask.
        valid_fraction: (T,) fraction of these with a depth reading.
        plausible: (T,) whether they can be the stem's, see `OwnReadings`.
        doubtful: (T,) whether they may be of something in front.
        median_m: (T,) their median depth; 1 where there is no reading.
    """

    readings: Readings
    on_stem_fraction: Float
    valid_fraction: Float
    plausible: Bool
    doubtful: Bool
    median_m: Float


def _sample_depth(
    frame: DepthFrame, regions: SearchRegions, outline: Outline | None
) -> _DepthSamples:
    """Sample the depth on a grid between the edges of each stem."""
    position, half = regions.stations_px, regions.half_px[:, None]
    edges_px = np.broadcast_to(OUTWARDS * half, (2, *position.shape))
    if outline is not None:
        edges_px = _fitted_edges(position, outline, edges_px)
    left, right = edges_px
    middle, reach = (left + right) / 2, (right - left) / 2
    shift_px: Float = np.zeros(len(position))
    within = np.full_like(reach, DEPTH_WITHIN)
    if outline is not None:
        shift_px = outline.depth_shift_px
        # Smoothed depth near an edge is a mixture with the background.
        mixed = outline.depth_ramp_px / 2 / np.maximum(reach, 1e-3)
        within = np.clip(1 - mixed, _MIN_WITHIN, DEPTH_WITHIN)
    across_px = middle[..., None] + (within * reach)[..., None] * _ACROSS
    xy_px = regions.points(across_px)
    beams = None
    if frame.beams_px is not None:
        beams = beams_on_stems(frame, regions, edges_px, within, _ACROSS, xy_px)
        xy_px = beams.xy_px
    rays, depth_m = frame.readings(xy_px)
    if shift_px.any():
        depth_m = frame.depth_at(regions.points(across_px + shift_px[:, None, None]))
    if beams is not None:
        depth_m = np.where(beams.enough[:, None, None], depth_m, 0.0)
    on_stem = (frame.mask_probability(xy_px) >= MASK_THRESHOLD) & frame.inside(xy_px)
    depth_m = np.where(on_stem, depth_m, 0.0)
    own = own_readings(frame, regions, edges_px, depth_m, on_stem, xy_px)
    depth_m = own.depth_m
    count = len(position)
    spacing = np.stack(
        [
            2 * DEPTH_WITHIN * regions.half_px / _DEPTH_SAMPLES,
            (regions.span_px[:, 1] - regions.span_px[:, 0]) / STATIONS,
        ]
    )
    correlation = frame.settings.depth_correlation_px
    readings_per_error = np.maximum(correlation / np.maximum(spacing, 1e-3), 1.0).prod(0)
    if beams is not None:
        readings_per_error = beams.places_per_beam
    flat = depth_m.reshape(count, -1)
    with_depth = flat > 0
    seen = on_stem.reshape(count, -1).sum(1)
    median = masked_medians(flat, with_depth)
    return _DepthSamples(
        readings=Readings(rays.reshape(count, -1, 3), flat, readings_per_error),
        on_stem_fraction=seen / flat.shape[1],
        valid_fraction=with_depth.sum(1) / np.maximum(seen, 1),
        plausible=own.plausible,
        doubtful=own.doubtful,
        median_m=np.where(median > 0, median, 1.0),
    )


def _fitted_edges(position: Float, outline: Outline, fallback: Float) -> Float:
    """(2, T, S) straight lines fitted to edges; `fallback` with fewer than two valid stations."""
    edges_px = np.where(outline.valid, outline.edges_px, 0.0)
    value, slope = fit_lines(position, edges_px, outline.valid.astype(np.float64))
    line = value[..., None] + slope[..., None] * position
    return np.where(outline.valid.sum(2, keepdims=True) >= 2, line, fallback)


def _edges(
    frame: DepthFrame,
    regions: SearchRegions,
    outline: Outline | None,
    keypoints: Keypoints,
    depth_m: Float,
) -> StemEdges:
    """The edges as rays; `depth_m` (T,) is the depth of the stems."""
    count = len(depth_m)
    has = keypoints.has_section[:, None, None]
    middle = _section_from_mask(regions, outline, keypoints)
    edges_px = keypoints.xy_px[:, [LEFT, RIGHT]]
    if outline is not None:
        edges_px = _moved_inwards(edges_px, outline.keypoints_inwards_px)
    section_px = np.where(has, edges_px, middle[:, None])
    section = frame.rays(section_px)
    std_px = np.hypot(keypoints.std_px[:, LEFT, 0], keypoints.std_px[:, RIGHT, 0]) / np.sqrt(2)
    sides: Float = np.ones((2, count, STATIONS, 3))
    valid = np.zeros((2, count, STATIONS), np.bool_)
    mask_std_px = np.full(count, np.inf)
    if outline is not None and frame.masks is not None:
        points = regions.points(outline.edges_px[..., None])[..., 0, :]
        valid = outline.valid
        sides = frame.rays(np.where(valid[..., None], points, 0.0))
        mask_std_px = outline.std_px
        if frame.masks_given:
            scatter_px = outline.scatter_px / np.sqrt(STATIONS_PER_ERROR)
            mask_std_px = np.hypot(mask_std_px, scatter_px)
    return StemEdges(
        camera=frame.camera,
        section=section,
        section_std_px=np.where(keypoints.has_section, std_px, np.inf),
        sides=sides,
        valid=valid,
        mask_std_px=mask_std_px,
        distance_m=depth_m * lengths(section.mean(1)),
        butt_swell=keypoints.has_section * frame.settings.butt_swell,
        butt_swell_std=keypoints.has_section * frame.settings.butt_swell_std,
    )


def _moved_inwards(edges_px: Float, inwards_px: float) -> Float:
    """Both edges (T, 2, 2) of sections, each moved towards the other, in either order."""
    apart = edges_px[:, ::-1] - edges_px
    length_px = np.maximum(lengths(apart), 1.0)[..., None]
    return np.asarray(edges_px + inwards_px * apart / length_px)


def _section_from_mask(
    regions: SearchRegions, outline: Outline | None, keypoints: Keypoints
) -> Float:
    """(T, 2) where to measure the diameter of stems without keypoints at their section, in px.

    If the model predicts keypoints, the cut is below the image, and the section is near the lower
    end of the visible part. Otherwise it is in the middle of the visible part.
    """
    if outline is None:
        return regions.origin_px
    valid = outline.valid.all(0)
    position = np.where(valid, regions.stations_px, np.inf)
    count = valid.sum(1)
    quantile = SECTION_QUANTILE if keypoints.offered else 0.5
    rank = np.minimum((quantile * count).astype(np.intp), STATIONS - 1)
    picked = pick(np.sort(position), rank)[:, None]
    picked = np.where(np.isfinite(picked), picked, 0.0)
    return np.asarray(regions.origin_px + picked * regions.along)


def _axis_rays(
    frame: DepthFrame, regions: SearchRegions, edges: StemEdges, keypoints: Keypoints
) -> tuple[Float, Float]:
    """Rays to points on the axes, and the standard deviations of their angles.

    The points are the middle of the section, the two axis keypoints, and the midpoints between
    the edges at the stations.

    Returns:
        Rays (T, N, 3), and (T, N) standard deviations in radians.
    """
    rad_per_px = 1 / (frame.camera.fx * lengths(edges.middle))[:, None]
    section = _bisectors(edges.section.swapaxes(0, 1)[:, :, None])
    section_std = edges.section_std_px[:, None] / np.sqrt(2) * rad_per_px
    picked = [MIDDLE, TOP]
    given = keypoints.given[:, picked]
    points = frame.rays(np.where(given[..., None], keypoints.xy_px[:, picked], 0.0))
    points_std = np.where(given, keypoints.std_px[:, picked, 0] * rad_per_px, np.inf)
    middles = _bisectors(edges.sides)
    height_m = regions.stations_px * (edges.distance_m / frame.camera.fx)[:, None]
    bend = STEM_BEND_PER_M * height_m**2 / edges.distance_m[:, None]
    centred = edges.valid.all(0) & _near_centre_line(frame, regions, middles)
    mask_std = edges.mask_std_px[:, None] * rad_per_px * np.sqrt(STATIONS_PER_ERROR / 2)
    middle_std = np.where(centred, np.hypot(mask_std, bend), np.inf)
    rays = np.concatenate([section, points, middles], 1)
    return rays, np.concatenate([section_std, points_std, middle_std], 1)


def _near_centre_line(frame: DepthFrame, regions: SearchRegions, middles: Float) -> Bool:
    """(T, S) whether rays (T, S, 3) pass near the centre lines of their regions."""
    line = regions.points(np.zeros((*middles.shape[:2], 1)))[:, :, 0]
    off = lengths(frame.rays(line) - middles / middles[..., 2:])
    return np.asarray(off * frame.camera.fx < _MAX_OFF_CENTRE * regions.half_px[:, None])


def _bisectors(rays: Float) -> Float:
    """Rays (..., 3) that bisect the angles between two sets of rays (2, ..., 3)."""
    left, right = unit(rays)
    return np.asarray(left + right)
