"""Pinhole views of the stems through a lens that bends straight lines.

The measurement lays straight lines along the edges of stems, and takes one focal length for a stem.
Both hold for a pinhole. Through a fisheye or a strong wide angle they do not, so the stems are
measured in pinhole views that are turned towards them. A view touches the lens: at its axis it has
the lens's place in the picture and pixels per radian, so that it neither loses nor invents pixels,
and errors in pixels keep their meaning. The depth map is not resampled: each reading is taken from
its own pixel and turned.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from calib import PinholeCamera, pixels_to_rays, project_points
from calib.directions import lengths, unit
from edgetree.detections import TreeDetections
from edgetree.measure.constants.outlines import MAX_LENS_BEND
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame, MaskGrid
from edgetree.measure.keypoints import Keypoints
from edgetree.measure.rig_uncertainty import TurnedErrors

# Stems share a view within this angle of its first one: a pinhole's pixels per radian change by
# 13 % over it.
_REACH_DEG = 20.0
# Cells of a view's mask per cell of a network's mask, so that resampling does not blur its edges.
_FINER = 2
# Points along each side of the image or of a box.
_ALONG_SIDE = 17
# Directions further from a view's axis than this, as a tangent, are left out of its extent.
_MAX_TANGENT = 3.0
# A place in px that is outside every image.
_OUTSIDE_PX = -1e4
# Smallest focal length of a view, in widths of the image: that of a plausible camera.
_MIN_FOCAL = 0.25


@dataclass(frozen=True, eq=False, kw_only=True)
class TurnedFrame(DepthFrame):
    """A frame as a pinhole camera turned about the same centre sees it.

    Its pixels are those of `camera`; they may lie outside of its nominal size. Its rays and points
    are in the view's axes.

    Attributes:
        source: The frame, with the masks of all its trees.
    """

    source: DepthFrame

    @cached_property
    def limits_px(self) -> tuple[Float, Float]:
        """(2,) lowest and (2,) highest place at which the image has pixels."""
        # Its border alone may lie too far from the view's axis.
        ticks = np.linspace(*self.source.limits_px, _ALONG_SIDE)
        places = np.stack(np.meshgrid(*ticks.T), -1).reshape(-1, 2)
        box_px = _extent(self.to_view_px(places))
        return box_px[:2], box_px[2:]

    def to_view_px(self, xy_px: Float) -> Float:
        """Points (..., 2) of the image in the view's pixels; NaN far from the view's axis."""
        turned = self.from_camera(pixels_to_rays(self.source.camera, xy_px))
        known = lengths(turned[..., :2]) < _MAX_TANGENT * turned[..., 2]
        return np.where(known[..., None], project_points(self.camera, turned), np.nan)

    @cached_property
    def beams_px(self) -> Float | None:
        """As of the whole frame, in the view's pixels and near its axis."""
        beams_px = self.source.beams_px
        if beams_px is None:
            return None
        seen_px = self.to_view_px(beams_px)
        return seen_px[np.isfinite(seen_px).all(1)]

    def to_source_px(self, xy_px: Float) -> Float:
        """Points (..., 2) of the view in the image's pixels; far outside where it has none."""
        camera = self.source.camera
        rays = self.to_camera(self.rays(xy_px))
        found = project_points(camera, rays)
        tangent = lengths(rays[..., :2]) / np.maximum(rays[..., 2], 1e-9)
        # The model of a lens may fold directions beyond its field back into the image.
        within = (tangent <= _largest_tangent(camera)) & np.isfinite(found).all(-1)
        return np.where(within[..., None], found, _OUTSIDE_PX)

    def inside(self, xy_px: Float, margin_px: Float | float = 0.0) -> Bool:
        """As of the whole frame, in the image's own pixels."""
        return self.source.inside(self.to_source_px(xy_px), margin_px)

    def on_any_stem(self, xy_px: Float) -> Bool:
        """As of the whole frame."""
        return self.source.on_any_stem(self.to_source_px(xy_px))

    def readings(self, xy_px: Float) -> tuple[Float, Float]:
        """As of the whole frame: rays in the view's axes, and depth along its axis."""
        rays, depth_m = self.source.readings(self.to_source_px(xy_px))
        points = self.from_camera(rays * depth_m[..., None])
        known = points[..., 2] > 0
        turned = points / np.where(known, points[..., 2], 1.0)[..., None]
        rays = np.where(known[..., None], turned, self.rays(xy_px))
        return rays, np.where(known, points[..., 2], 0.0)

    def depth_at(self, xy_px: Float) -> Float:
        """Depth (...) along the view's axis at its points (..., 2)."""
        return self.readings(xy_px)[1]


class View(NamedTuple):
    """Some stems of a frame, and a frame to measure them in.

    Attributes:
        indices: (V,) numbers of the stems.
        frame: The frame, or a view of it.
        boxes_px: (V, 4) their boxes in it.
        keypoints: Their keypoints in it.
    """

    indices: Index
    frame: DepthFrame
    boxes_px: Float
    keypoints: Keypoints


def stem_views(frame: DepthFrame, trees: TreeDetections) -> list[View]:
    """Views for all stems: the frame itself, or turned ones if its lens bends straight lines."""
    boxes_px = trees.boxes_px.astype(np.float64)
    if not bends_lines(frame.camera):
        keypoints = Keypoints.from_detections(trees, frame.settings)
        return [View(np.arange(len(trees)), frame, boxes_px, keypoints)]
    borders = [_box_border(box) for box in boxes_px]
    if frame.masks is not None:
        pairs = zip(frame.masks, borders, strict=True)
        borders = [_mask_border(mask, border) for mask, border in pairs]
    directions = unit(
        np.stack([unit(pixels_to_rays(frame.camera, border)).mean(0) for border in borders])
    )
    return [
        _turned_view(frame, trees, group, unit(directions[group].mean(0)), borders)
        for group in _groups(directions)
    ]


@lru_cache(maxsize=4)
def bends_lines(camera: PinholeCamera) -> bool:
    """Whether straight lines along the picture's sides bend by `MAX_LENS_BEND`."""
    if not camera.distortion:
        return False
    size = np.array([camera.width, camera.height])
    for axis in (0, 1):
        for place in (0.1, 0.9):
            ends = np.full((2, 2), place)
            ends[:, axis] = 0.1, 0.9
            rays = pixels_to_rays(camera, ends * size)
            share = np.linspace(0, 1, 9)[:, None]
            # Depths in proportion to the directions' lengths keep wide lines evenly spread.
            line = (1 - share) * unit(rays[0]) + share * unit(rays[1])
            first, *between, last = project_points(camera, line)
            chord = unit(last - first)
            off = (np.array(between) - first) @ np.array([-chord[1], chord[0]])
            if np.abs(off).max() > MAX_LENS_BEND * size[1 - axis]:
                return True
    return False


def _groups(directions: Float) -> list[Index]:
    """Numbers of unit directions (T, 3) in groups within `_REACH_DEG` of their first one."""
    left, groups = np.arange(len(directions)), []
    while len(left):
        near = directions[left] @ directions[left[0]] >= np.cos(np.radians(_REACH_DEG))
        near[0] = True
        groups.append(left[near])
        left = left[~near]
    return groups


def _turned_view(
    frame: DepthFrame, trees: TreeDetections, indices: Index, axis: Float, borders: list[Float]
) -> View:
    """The view of some stems along an axis (3,), a unit vector in the camera's axes.

    Args:
        frame: The whole frame.
        trees: All its trees.
        indices: (V,) numbers of the stems.
        axis: Axis of the view.
        borders: Points (N, 2) on the outline of each of the frame's stems, in px.
    """
    rotation = _turn_to(axis)
    camera = _touching(frame.camera, rotation)
    cosine = float(axis[2])
    settings = replace(
        frame.settings,
        # An error of the depth moves a reading along its ray, by the same share of both depths.
        depth_noise_per_m=frame.settings.depth_noise_per_m * cosine,
        depth_bias_per_m=frame.settings.depth_bias_per_m * cosine,
        depth_noise_m=frame.settings.depth_noise_m / cosine,
        depth_bias_m=frame.settings.depth_bias_m / cosine,
    )
    turn = np.arccos(min(cosine, 1.0))
    rig = TurnedErrors(
        scale=frame.rig.scale,
        ray=float(np.hypot(frame.rig.ray * frame.camera.fx / camera.fx, turn * frame.rig.focal)),
        focal=frame.rig.focal,
        vertical_rad=frame.rig.vertical_rad,
        mounting_rad=frame.rig.mounting_rad,
        placed=frame.rig.placed,
        rotation=rotation,
    )
    view = TurnedFrame(
        camera=camera,
        depth_m=frame.depth_m,
        masks=None,
        settings=settings,
        masks_given=frame.masks_given,
        rig=rig,
        rotation=rotation,
        is_sparse=frame.is_sparse,
        by_network=frame.by_network,
        source=frame,
    )
    boxes_px = np.stack([_extent(view.to_view_px(borders[index])) for index in indices])
    if frame.masks is not None:
        finer = 1 if frame.masks_given else _FINER
        pairs = zip(indices, boxes_px, strict=True)
        masks = [_turned_mask(view, frame.masks[index], box, finer) for index, box in pairs]
        view = replace(view, masks=masks)
    keypoints = Keypoints.from_detections(trees.select(indices), frame.settings)
    xy_px = view.to_view_px(keypoints.xy_px)
    known = np.asarray(np.isfinite(xy_px).all(2))
    keypoints = replace(
        keypoints,
        xy_px=np.where(known[..., None], xy_px, 0.0),
        given=keypoints.given & known,
        within=keypoints.within & known,
    )
    return View(indices, view, boxes_px, keypoints)


def _turn_to(axis: Float) -> Float:
    """(3, 3) shortest rotation that turns a unit vector (3,) to the third axis (Rodrigues)."""
    x, y, z = axis.tolist()
    cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + z))


def _touching(camera: PinholeCamera, rotation: Float) -> PinholeCamera:
    """The pinhole camera with a lens's place and pixels per radian across a stem at its axis."""
    step = 1e-3
    near = np.array([[-step, 0.0, 1.0], [step, 0.0, 1.0], [0.0, 0.0, 1.0]])
    left, right, middle = project_points(camera, near @ rotation)
    focal = max(float(lengths(right - left)) / (2 * step), _MIN_FOCAL * camera.width)
    x, y = np.clip(middle - 0.5, 0, [camera.width, camera.height]).tolist()
    return PinholeCamera(camera.width, camera.height, focal, focal, x, y)


def _extent(points_px: Float) -> Float:
    """(4,) box of points (N, 2), without those that are NaN."""
    known = points_px[np.isfinite(points_px).all(1)]
    return np.concatenate([known.min(0), known.max(0)]) if len(known) else np.zeros(4)


def _box_border(box_px: Float) -> Float:
    """(N, 2) points along the sides of a box (4,)."""
    (x0, y0, x1, y1), share = box_px.tolist(), np.linspace(0, 1, _ALONG_SIDE)
    x, y = x0 + (x1 - x0) * share, y0 + (y1 - y0) * share
    sides = [(x, np.full_like(x, y0)), (x, np.full_like(x, y1))]
    sides += [(np.full_like(y, x0), y), (np.full_like(y, x1), y)]
    return np.concatenate([np.stack(side, -1) for side in sides])


def _mask_border(mask: MaskGrid, otherwise: Float) -> Float:
    """(N, 2) corners of a mask's cells at the left and right ends of its rows, in px."""
    inside = mask.grid >= MASK_THRESHOLD
    rows = np.flatnonzero(inside.any(1))
    if not len(rows):
        return otherwise
    cell = (mask.box_px[2:] - mask.box_px[:2]) / mask.grid.shape[::-1]
    left = inside[rows].argmax(1)
    right = inside.shape[1] - inside[rows, ::-1].argmax(1)
    corners = [(side, end) for side in (left, right) for end in (rows, rows + 1)]
    return np.concatenate([mask.box_px[:2] + np.stack(each, -1) * cell for each in corners])


def _turned_mask(view: TurnedFrame, mask: MaskGrid, box_px: Float, finer: int) -> MaskGrid:
    """A mask in a view's pixels, within a box (4,) of them."""
    size = box_px[2:] - box_px[:2]
    cell = (mask.box_px[2:] - mask.box_px[:2]) / mask.grid.shape[::-1] / finer
    if not (size > 0).all() or not (cell > 0).all():
        return MaskGrid(np.zeros((1, 1), np.float32), np.zeros(4))
    columns, rows = np.ceil(size / cell).astype(int).tolist()
    x = box_px[0] + (np.arange(columns) + 0.5) / columns * size[0]
    y = box_px[1] + (np.arange(rows) + 0.5) / rows * size[1]
    places = view.to_source_px(np.stack(np.meshgrid(x, y), -1))
    column, row = (
        (places[..., axis] * factor + summand).astype(np.float32)
        for axis, (factor, summand) in enumerate(mask.to_cells)
    )
    return MaskGrid(mask.at(column, row), box_px, finer)


@lru_cache(maxsize=4)
def _largest_tangent(camera: PinholeCamera) -> float:
    """Tangent of the largest angle between a pixel's direction and the optical axis."""
    border = _box_border(np.array([0.0, 0.0, camera.width, camera.height]))
    return float(lengths(pixels_to_rays(camera, border)[:, :2]).max()) * (1 + 1e-6)
