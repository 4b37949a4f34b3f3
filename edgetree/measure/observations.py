"""Collect what a frame shows of its stems: keypoints, outlines and depth readings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.edge_lines import fit_lines, masked_medians, pick
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.keypoints import (
    CUT_OFF_PX,
    LEFT,
    MIDDLE,
    MIN_WIDTH_PX,
    RIGHT,
    TOP,
    Keypoints,
)
from edgetree.measure.outline import Outline, regions_from_masks, trace_outline
from edgetree.measure.regions import OUTWARDS, STATIONS, SearchRegions, line_spans
from edgetree.measure.section import lengths
from edgetree.measure.settings import reference_px
from edgetree.measure.stem_fit import Readings
from edgetree.measure.width import StemEdges

__all__ = ["StemObservations", "observe_stems"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

# Depth is sampled at this many points across the stem, within this fraction of its half width. It
# is below `MAX_USED_OFFSET`, so that small corrections of the edges lose no samples.
_DEPTH_SAMPLES, _DEPTH_WITHIN = 9, 0.75
_DEPTH_ACROSS = np.linspace(-_DEPTH_WITHIN, _DEPTH_WITHIN, _DEPTH_SAMPLES)
# A midpoint between the mask's edges this far off the centre line, in half widths, is not used.
_MAX_OFF_CENTRE = 0.35
# The edges of a mask have correlated errors: this many stations count as one.
_STATIONS_PER_ERROR = 5.0
# Bend of a stem in 1/m, times the squared distance along it.
_BEND_PER_M = 0.02
# An object in front of a stem is searched for this far from the stem's edge, in half widths or px.
# It is nearer than the stem by this factor and this many metres.
_BESIDE, _MIN_BESIDE_PX = 0.15, 3.0
_NEARER, _NEARER_M = 0.98, 0.05
# Mask edges within this distance from the border of the image are not used: px plus standard
# deviations of a mask edge. The masks of networks end up to the second distance before the border
# that cuts their stem off, in px of an image of 1280 px width, and further where `cut_off` is set.
_BORDER_PX, _NETWORK_BORDER_PX, _BORDER_STDS = 1.0, 9.0, 2.0
# If the cut is not in the image, the diameter is measured at this quantile of the visible length,
# from below.
_LOWEST = 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
class StemObservations:
    """Everything a frame shows of T stems.

    Attributes:
        outline: edges in the masks; None if there are no masks.
        edges: edges as viewing rays.
        axis_rays: (T, N, 3) viewing rays to points on the axes.
        axis_std_rad: (T, N) standard deviations of their angles; infinite for rays to ignore.
        readings: depth readings within the outlines.
        on_stem_fraction: (T,) fraction of the depth samples that are on the stem's mask.
        valid_depth_fraction: (T,) fraction of these that have a depth reading.
    """

    outline: Outline | None
    edges: StemEdges
    axis_rays: Float
    axis_std_rad: Float
    readings: Readings
    on_stem_fraction: Float
    valid_depth_fraction: Float


def observe_stems(frame: DepthFrame, boxes_px: Float, keypoints: Keypoints) -> StemObservations:
    """Collect outlines, edges, axis points and depth readings of all stems.

    Args:
        frame: depth, masks and camera.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.
        keypoints: keypoints of the same trees.
    """
    regions = _search_regions(frame, boxes_px, keypoints)
    outline = None
    if frame.masks is not None:
        outline = trace_outline(frame, regions, _border_px(frame, keypoints))
        regions = outline.regions
    depth = _sample_depth(frame, regions, outline)
    if outline is not None:
        outline = _without_occluded_edges(frame, outline, depth.median_m)
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
    )


def _border_px(frame: DepthFrame, keypoints: Keypoints) -> Float:
    """(2, T) px from the border within which left and right mask edges are not used."""
    cut_off = keypoints.cut_off.T
    if frame.masks_given:
        border_px = np.full(cut_off.shape, _BORDER_PX)
    else:
        px = np.where(cut_off, CUT_OFF_PX, _NETWORK_BORDER_PX)
        border_px = px * reference_px(frame.camera.width)
    return np.asarray(border_px + _BORDER_STDS * frame.mask_std_px())


def _search_regions(frame: DepthFrame, boxes_px: Float, keypoints: Keypoints) -> SearchRegions:
    """Regions around the stems, from keypoints, or from masks where the section has none.

    The centre line starts in the middle of the section. It points to the keypoints further up, or
    is at right angles to the section if they are too close to it.
    """
    left, right = keypoints.xy_px[:, LEFT], keypoints.xy_px[:, RIGHT]
    origin = (left + right) / 2
    half = np.maximum(lengths(right - left) / 2, MIN_WIDTH_PX / 2)
    upwards = np.zeros_like(origin)
    for keypoint in (MIDDLE, TOP):
        upwards += keypoints.given[:, keypoint, None] * (keypoints.xy_px[:, keypoint] - origin)
    side = (right - left) * np.where(right[:, :1] < left[:, :1], -1.0, 1.0)
    perpendicular = np.stack([side[:, 1], -side[:, 0]], -1)
    known = lengths(upwards) > 2 * half
    along = np.where(known[:, None], upwards, perpendicular)
    without = ~keypoints.has_section
    limit = np.full((len(origin), 2), np.inf) * (-1.0, 1.0)
    if without.any() and frame.masks is not None:
        indices = np.flatnonzero(without)
        few = replace(frame, masks=[frame.masks[index] for index in indices])
        found = regions_from_masks(few, boxes_px[indices])
        origin[indices], along[indices] = found.origin_px, found.along
        half[indices], limit[indices] = found.half_px, found.span_px
    length = lengths(along)[:, None]
    along = np.where(length > 0, along / np.where(length > 0, length, 1.0), np.array([0.0, -1.0]))
    span = line_spans(origin, along, boxes_px)
    span = np.stack([np.maximum(span[:, 0], limit[:, 0]), np.minimum(span[:, 1], limit[:, 1])], -1)
    return SearchRegions(origin, along, half, span)


class _DepthSamples(NamedTuple):
    """Depth samples on T stems.

    Attributes:
        readings: the samples as readings.
        on_stem_fraction: (T,) fraction of the samples on the stem's mask.
        valid_fraction: (T,) fraction of these with a depth reading.
        median_m: (T,) their median depth; 1 where there is no reading.
    """

    readings: Readings
    on_stem_fraction: Float
    valid_fraction: Float
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
    xy_px = regions.points(middle[..., None] + reach[..., None] * _DEPTH_ACROSS)
    rays, depth_m = frame.readings(xy_px)
    on_stem = (frame.mask_probability(xy_px) >= MASK_THRESHOLD) & frame.inside(xy_px)
    depth_m = np.where(on_stem, depth_m, 0.0)
    count = len(position)
    spacing = np.stack(
        [
            2 * _DEPTH_WITHIN * regions.half_px / _DEPTH_SAMPLES,
            (regions.span_px[:, 1] - regions.span_px[:, 0]) / STATIONS,
        ]
    )
    correlation = frame.settings.depth_correlation_px
    per_error = np.maximum(correlation / np.maximum(spacing, 1e-3), 1.0).prod(0)
    flat = depth_m.reshape(count, -1)
    with_depth = flat > 0
    seen = on_stem.reshape(count, -1).sum(1)
    median = masked_medians(flat, with_depth)
    return _DepthSamples(
        readings=Readings(rays.reshape(count, -1, 3), flat, per_error),
        on_stem_fraction=seen / flat.shape[1],
        valid_fraction=with_depth.sum(1) / np.maximum(seen, 1),
        median_m=np.where(median > 0, median, 1.0),
    )


def _without_occluded_edges(frame: DepthFrame, outline: Outline, depth_m: Float) -> Outline:
    """Invalidate edges next to which something is nearer than the stem, and so may hide its edge.

    `depth_m` (T,) is the depth of the stems.
    """
    settings, regions = frame.settings, outline.regions
    stem = depth_m[:, None, None]
    nearer = stem * _NEARER - 3 * settings.depth_noise_per_m * stem**2 - _NEARER_M
    step_px = np.maximum(_BESIDE * regions.half_px, _MIN_BESIDE_PX)[:, None]
    outwards_px = OUTWARDS * step_px
    beside = np.stack([outline.edges_px + times * outwards_px for times in (1, 2)], -1)
    depth = frame.depth_at(regions.points(beside))
    hidden = ((depth > 0) & (depth < nearer)).any(-1)
    return replace(outline, valid=outline.valid & ~hidden)


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
    section_px = np.where(has, keypoints.xy_px[:, [LEFT, RIGHT]], middle[:, None])
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
            scatter_px = outline.scatter_px / np.sqrt(_STATIONS_PER_ERROR)
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
    quantile = _LOWEST if keypoints.offered else 0.5
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
    bend = _BEND_PER_M * height_m**2 / edges.distance_m[:, None]
    centred = edges.valid.all(0) & _near_centre_line(frame, regions, middles)
    mask_std = edges.mask_std_px[:, None] * rad_per_px * np.sqrt(_STATIONS_PER_ERROR / 2)
    middle_std = np.where(centred, np.hypot(mask_std, bend), np.inf)
    rays = np.concatenate([section, points, middles], 1)
    return rays, np.concatenate([section_std, points_std, middle_std], 1)


def _near_centre_line(frame: DepthFrame, regions: SearchRegions, middles: Float) -> Flags:
    """(T, S) whether rays (T, S, 3) pass near the centre lines of their regions."""
    line = regions.points(np.zeros((*middles.shape[:2], 1)))[:, :, 0]
    off = lengths(frame.rays(line) - middles / middles[..., 2:])
    return np.asarray(off * frame.camera.fx < _MAX_OFF_CENTRE * regions.half_px[:, None])


def _bisectors(rays: Float) -> Float:
    """Rays (..., 3) that bisect the angles between two sets of rays (2, ..., 3)."""
    unit = rays / lengths(rays)[..., None]
    return np.asarray(unit[0] + unit[1])
