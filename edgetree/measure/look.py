"""What a frame shows of its stems: keypoints, outlines and depth, gathered for all at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.detections import KEYPOINT_NAMES, TreeDetections
from edgetree.measure.frame import DepthFrame
from edgetree.measure.outline import (
    STATIONS,
    Outline,
    Strips,
    find_outline,
    medians,
    spans,
    start_from_masks,
    weighted_lines,
)
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.stem import Readings
from edgetree.measure.width import StemEdges

__all__ = ["CUT", "Keypoints", "StemLook", "look_at_stems"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

CUT, LEFT, RIGHT, MIDDLE, TOP = range(len(KEYPOINT_NAMES))

_SHOWN = 0.5
_LEAST_WIDTH_PX = 1.0
_BOTTOM_STDS = 12.0
# Depth is read at so many places across the stem, within this share of its width.
_ACROSS, _WITHIN = 9, 0.8
# A middle between the edges of the mask that lies further off the others is no middle.
_OFF_MIDDLE = 0.35
# The edges of a mask err together along a stem: so many stations are worth one.
_STATIONS_PER_ERROR = 5.0
_BEND_PER_M = 0.02
# What stands beside a stem and hides it: looked for so far from its edge, and nearer by so much.
_BESIDE, _BESIDE_PX = 0.15, 3.0
_NEARER, _NEARER_M = 0.98, 0.05
# A mask ends at the border of the picture, and the stem does not: so near is at the border.
_BORDER_PX, _BORDER_STDS = 1.0, 2.0
# Without a cut in the image a stem is measured as low as this share of what shows from below.
_LOWEST = 0.1


@dataclass(frozen=True, eq=False)
class Keypoints:
    """The keypoints of T trees.

    Attributes:
        xy_px: (T, 5, 2).
        given: (T, 5) which of them say something: scored, and at most an image's size outside it.
        std_px: (T, 5, 2) errors across and along the stem.
        offered: whether the model gives keypoints at all.
        within: (T, 5) which lie inside the image for certain: at its border they may be beyond.
    """

    xy_px: Float
    given: Flags
    std_px: Float
    within: Flags
    offered: bool

    @classmethod
    def of(cls, trees: TreeDetections, settings: MeasureSettings) -> Keypoints:
        """The flatter a heat map over the box, the larger the error; across, edges hold the heat
        map within the box's width; along, nothing does.
        """
        count = len(trees)
        values = np.zeros((count, len(KEYPOINT_NAMES), 3))
        if trees.keypoints_px is not None:
            values = trees.keypoints_px.astype(np.float64)
        size = np.array([trees.image_width, trees.image_height])
        near = (np.abs(values[..., :2] - size / 2) <= 1.5 * size).all(2)
        extent = np.maximum(trees.boxes_px[:, 2:] - trees.boxes_px[:, :2], 0.0).astype(np.float64)
        extent[:, 1] = np.sqrt(extent.prod(1))
        score = np.clip(values[..., 2:], 1e-4, 1.0)
        share = np.array([settings.keypoint_spread, settings.keypoint_slide])
        spread = share * extent[:, None] / np.sqrt(score)
        std_px = np.hypot(settings.keypoint_std_px, spread)
        given = (values[..., 2] > 0) & near
        inside = (values[..., :2] > std_px) & (values[..., :2] < size - std_px)
        within = given & inside.all(2)
        # A stem that goes on below the picture may be cut there, and networks put the keypoint
        # into the picture then.
        cut_std_px = std_px[:, CUT, 1]
        goes_on = trees.boxes_px[:, 3] > trees.image_height - np.maximum(cut_std_px, 1.0)
        low = values[:, CUT, 1] > trees.image_height - _BOTTOM_STDS * cut_std_px
        within[:, CUT] &= ~(goes_on & low)
        return cls(values[..., :2], given, std_px, within, trees.keypoints_px is not None)

    @cached_property
    def has_section(self) -> Flags:
        """(T,) both edges of the section are given, apart from each other."""
        width = np.linalg.norm(self.xy_px[:, RIGHT] - self.xy_px[:, LEFT], axis=1)
        size_known = width >= _LEAST_WIDTH_PX
        return np.asarray(self.within[:, LEFT] & self.within[:, RIGHT] & size_known)


@dataclass(frozen=True, eq=False)
class StemLook:
    """All that is seen of T stems.

    Attributes:
        outline: of the masks; None where there are none.
        edges: their rays.
        axis_rays: (T, N, 3) rays to the axes, and `axis_std_rad` (T, N) their errors.
        readings: the depth inside the outlines.
        places: (T,) share of the places looked at that show the stem.
        valid_depth: (T,) share of these that have a reading.
    """

    outline: Outline | None
    edges: StemEdges
    axis_rays: Float
    axis_std_rad: Float
    readings: Readings
    places: Float
    valid_depth: Float


def look_at_stems(frame: DepthFrame, boxes_px: Float, keypoints: Keypoints) -> StemLook:
    """Gather what a frame shows of stems that have keypoints at their section, or masks."""
    strips = _strips(frame, boxes_px, keypoints)
    outline = None
    if frame.masks is not None:
        outline = find_outline(frame, strips, _BORDER_STDS * frame.mask_std_px() + _BORDER_PX)
    strips = strips if outline is None else outline.strips
    readings, places, valid_depth, depth_m = _read_depth(frame, strips, outline)
    if outline is not None:
        outline = _unhidden(frame, outline, depth_m)
    edges = _edges(frame, strips, outline, keypoints, depth_m)
    rays, std_rad = _axis_rays(frame, strips, edges, keypoints)
    return StemLook(outline, edges, rays, std_rad, readings, places, valid_depth)


def _strips(frame: DepthFrame, boxes_px: Float, keypoints: Keypoints) -> Strips:
    left, right = keypoints.xy_px[:, LEFT], keypoints.xy_px[:, RIGHT]
    origin = (left + right) / 2
    half = np.maximum(np.linalg.norm(right - left, axis=1) / 2, _LEAST_WIDTH_PX / 2)
    upwards = np.zeros_like(origin)
    for index in (MIDDLE, TOP):
        upwards += keypoints.given[:, index, None] * (keypoints.xy_px[:, index] - origin)
    side = (right - left) * np.where(right[:, :1] < left[:, :1], -1.0, 1.0)
    square = np.stack([side[:, 1], -side[:, 0]], -1)
    known = np.linalg.norm(upwards, axis=1) > 2 * half
    along = np.where(known[:, None], upwards, square)
    bare = ~keypoints.has_section
    if bare.any() and frame.masks is not None:
        places = np.flatnonzero(bare)
        few = replace(frame, masks=[frame.masks[place] for place in places])
        found = start_from_masks(few, boxes_px[places])
        origin[places], along[places] = found.origin_px, found.along
        half[places] = found.half_px
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.where(length > 0, along / np.where(length > 0, length, 1.0), np.array([0.0, -1.0]))
    return Strips(origin, along, half, spans(origin, along, boxes_px))


def _read_depth(
    frame: DepthFrame, strips: Strips, outline: Outline | None
) -> tuple[Readings, Float, Float, Float]:
    """Depth on the stems, (T,) shares of the places that show the stem, and of these that have
    depth, and its medians.
    """
    place, half = strips.stations_px, strips.half_px[:, None]
    left, right = np.broadcast_to(-half, place.shape), np.broadcast_to(half, place.shape)
    if outline is not None:
        left = _smooth(place, outline.left_px, outline.left_valid, left)
        right = _smooth(place, outline.right_px, outline.right_valid, right)
    share = np.linspace(-_WITHIN, _WITHIN, _ACROSS)
    middle, reach = (left + right) / 2, (right - left) / 2
    xy_px = strips.points(middle[..., None] + reach[..., None] * share)
    rays, depth_m = frame.readings(xy_px)
    on_stem = (frame.shown(xy_px) >= _SHOWN) & frame.inside(xy_px)
    depth_m = np.where(on_stem, depth_m, 0.0)
    count = len(place)
    spacing = np.stack(
        [
            2 * _WITHIN * strips.half_px / _ACROSS,
            (strips.span_px[:, 1] - strips.span_px[:, 0]) / STATIONS,
        ]
    )
    correlation = frame.settings.depth_correlation_px
    per_error = np.maximum(correlation / np.maximum(spacing, 1e-3), 1.0).prod(0)
    flat = depth_m.reshape(count, -1)
    with_depth = flat > 0
    seen = on_stem.reshape(count, -1).sum(1)
    median = medians(flat, with_depth)
    readings = Readings(rays.reshape(count, -1, 3), flat, per_error)
    valid = with_depth.sum(1) / np.maximum(seen, 1)
    return readings, seen / flat.shape[1], valid, np.where(median > 0, median, 1.0)


def _unhidden(frame: DepthFrame, outline: Outline, depth_m: Float) -> Outline:
    """The outline without edges beside which something nearer stands: that hides the stem's own.

    `depth_m` (T,) is the stems'.
    """
    settings, strips = frame.settings, outline.strips
    stem = depth_m[:, None, None]
    nearer = stem * _NEARER - 3 * settings.depth_noise_per_m * stem**2 - _NEARER_M
    step = np.maximum(_BESIDE * strips.half_px[:, None], _BESIDE_PX)
    free = []
    for edge_px, outwards in ((outline.left_px, -step), (outline.right_px, step)):
        beside = np.stack([edge_px + outwards, edge_px + 2 * outwards], -1)
        depth = frame.depth_at(strips.points(beside))
        free.append(~((depth > 0) & (depth < nearer)).any(-1))
    return replace(
        outline,
        left_valid=outline.left_valid & free[0],
        right_valid=outline.right_valid & free[1],
    )


def _smooth(place: Float, edge: Float, valid: Flags, otherwise: Float) -> Float:
    """(T, S) the line along an edge; `otherwise` where hardly any of it shows."""
    value, slope = weighted_lines(place, np.where(valid, edge, 0.0), valid.astype(np.float64))
    line = value[:, None] + slope[:, None] * place
    return np.where(valid.sum(1, keepdims=True) >= 2, line, otherwise)


def _edges(
    frame: DepthFrame, strips: Strips, outline: Outline | None, keypoints: Keypoints, depth_m: Float
) -> StemEdges:
    count = len(depth_m)
    has = keypoints.has_section[:, None, None]
    middle = _section_from_mask(strips, outline, keypoints)
    section_px = np.where(has, keypoints.xy_px[:, [LEFT, RIGHT]], middle[:, None])
    section = frame.rays(section_px)
    std_px = np.hypot(keypoints.std_px[:, LEFT, 0], keypoints.std_px[:, RIGHT, 0]) / np.sqrt(2)
    left: Float = np.ones((count, STATIONS, 3))
    right = left
    left_valid = right_valid = np.zeros((count, STATIONS), np.bool_)
    mask_std_px = np.full(count, np.inf)
    if outline is not None and frame.masks is not None:
        points = strips.points(np.stack([outline.left_px, outline.right_px], -1))
        left_valid, right_valid = outline.left_valid, outline.right_valid
        known = np.stack([left_valid, right_valid], -1)[..., None]
        rays = frame.rays(np.where(known, points, 0.0))
        left, right = rays[:, :, 0], rays[:, :, 1]
        mask_std_px = frame.mask_std_px()
    reach = np.linalg.norm(section.mean(1), axis=1)
    return StemEdges(
        frame.camera,
        section,
        np.where(keypoints.has_section, std_px, np.inf),
        left,
        right,
        left_valid,
        right_valid,
        mask_std_px,
        depth_m * reach,
    )


def _section_from_mask(strips: Strips, outline: Outline | None, keypoints: Keypoints) -> Float:
    """(T, 2) where to measure stems without keypoints at their section: where they show lowest,
    since the cut is below; in the middle of what shows where there are no keypoints at all.
    """
    if outline is None:
        return strips.origin_px
    valid = outline.left_valid & outline.right_valid
    place = np.where(valid, strips.stations_px, np.inf)
    count = valid.sum(1)
    share = _LOWEST if keypoints.offered else 0.5
    rank = np.minimum((share * count).astype(np.intp), STATIONS - 1)
    picked = np.take_along_axis(np.sort(place, axis=1), rank[:, None], 1)
    picked = np.where(np.isfinite(picked), picked, 0.0)
    return np.asarray(strips.origin_px + picked * strips.along)


def _axis_rays(
    frame: DepthFrame, strips: Strips, edges: StemEdges, keypoints: Keypoints
) -> tuple[Float, Float]:
    """Rays to the axes: the section's middle, the axis keypoints, the middles of the outline."""
    pixel = 1 / (frame.camera.fx * np.linalg.norm(edges.section.mean(1), axis=1))[:, None]
    section = _between(edges.section[:, :1], edges.section[:, 1:])
    section_std = edges.section_std_px[:, None] / np.sqrt(2) * pixel
    picked = [MIDDLE, TOP]
    given = keypoints.given[:, picked]
    points = frame.rays(np.where(given[..., None], keypoints.xy_px[:, picked], 0.0))
    points_std = np.where(given, keypoints.std_px[:, picked, 0] * pixel, np.inf)
    middles = _between(edges.left, edges.right)
    height_m = strips.stations_px * (edges.distance_m / frame.camera.fx)[:, None]
    bend = _BEND_PER_M * height_m**2 / edges.distance_m[:, None]
    centred = edges.left_valid & edges.right_valid & _centred(frame, strips, middles)
    mask_std = edges.mask_std_px[:, None] * pixel * np.sqrt(_STATIONS_PER_ERROR / 2)
    middle_std = np.where(centred, np.hypot(mask_std, bend), np.inf)
    rays = np.concatenate([section, points, middles], 1)
    return rays, np.concatenate([section_std, points_std, middle_std], 1)


def _centred(frame: DepthFrame, strips: Strips, middles: Float) -> Flags:
    """(T, S) which rays lie near the middle lines of their strips."""
    line = strips.points(np.zeros((*middles.shape[:2], 1)))[:, :, 0]
    off = np.linalg.norm(frame.rays(line) - middles / middles[..., 2:], axis=2)
    return np.asarray(off * frame.camera.fx < _OFF_MIDDLE * strips.half_px[:, None])


def _between(left: Float, right: Float) -> Float:
    """Rays half-way between rays (..., 3)."""
    unit = [rays / np.linalg.norm(rays, axis=-1, keepdims=True) for rays in (left, right)]
    return np.asarray(unit[0] + unit[1])
