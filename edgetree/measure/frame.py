"""One frame as input to the measurement: depth, masks and camera, sampled at image points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from basetree.arrays import Bool, Float, Float32, Index
from calib import PinholeCamera, pixels_to_rays
from edgetree.detections import TreeDetections
from edgetree.measure.depth_steps import DepthSteps, depth_steps
from edgetree.measure.rig_uncertainty import NO_ERRORS, RigErrors
from edgetree.measure.settings import MeasureSettings, network_std_px, reference_px

# OpenCV samples at most 32,766 points in a row.
_MAX_POINTS = 30_000

MASK_THRESHOLD = 0.5
"""Mask probability from which a point counts as part of the stem."""


@dataclass(frozen=True, eq=False)
class MaskGrid:
    """A mask as probabilities on a regular grid over a box.

    Attributes:
        grid: (rows, columns) float32 probabilities.
        box_px: (4,) x0, y0, x1, y1 of the box in the image.
        finer: Cells per cell of the mask that this one is resampled from.
        whole: The mask that this one is cut out of, as it holds another stem too.
        edge_std_px: Standard deviation of an edge that comes from this.
    """

    grid: Float32
    box_px: Float
    finer: int = 1
    whole: MaskGrid | None = None
    edge_std_px: float = 0.0

    @classmethod
    def from_image(cls, mask: Bool) -> MaskGrid:
        """Crop an (H, W) bool mask to its bounding box; each pixel becomes one cell."""
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        if not len(rows):
            return cls(np.zeros((1, 1), np.float32), np.zeros(4))
        y0, y1, x0, x1 = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
        return cls(mask[y0:y1, x0:x1].astype(np.float32), np.array([x0, y0, x1, y1], np.float64))

    @property
    def cell_px(self) -> float:
        """Width in pixels of a cell of the original mask."""
        return self.finer * float(self.box_px[2] - self.box_px[0]) / float(self.grid.shape[1])

    @property
    def cell_height_px(self) -> float:
        """Height in pixels of a cell of the original mask."""
        return self.finer * float(self.box_px[3] - self.box_px[1]) / float(self.grid.shape[0])

    @cached_property
    def to_cells(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Factor and summand that turn x, and y, of image points into columns, and rows.

        Those of an empty box lead outside the grid.
        """
        x0, y0, x1, y1 = self.box_px.tolist()
        if not (x1 > x0 and y1 > y0):
            return (0.0, -2.0), (0.0, -2.0)
        rows, columns = self.grid.shape
        wide, high = columns / (x1 - x0), rows / (y1 - y0)
        return (wide, -x0 * wide - 0.5), (high, -y0 * high - 0.5)

    def at(self, column: Float32, row: Float32, out: Float32 | None = None) -> Float32:
        """Probabilities (A, B) at places (A, B) on the grid, bilinear; 0 outside.

        They are written to `out` if it is given.
        """
        border = cv2.BORDER_CONSTANT
        found = cv2.remap(self.grid, column, row, cv2.INTER_LINEAR, out, borderMode=border)
        return np.asarray(found, np.float32)


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """A depth map with its camera and the masks of T trees.

    Attributes:
        camera: Intrinsics for the depth map's size.
        depth_m: (H, W) depth in metres; 0, NaN or infinite where there is no reading.
        masks: One per tree, or None if the model gives no masks.
        settings: Assumptions of the measurement.
        masks_given: Whether the caller gave the masks, at the image's size.
        rig: Errors of the rig, for vectors in the camera's axes.
        rotation: (3, 3) from the camera's axes to those of the frame's rays; None if they are the
            same.
        is_sparse: Whether the readings are those of single beams.
        by_network: Whether a network drew the masks.
    """

    camera: PinholeCamera
    depth_m: Float
    masks: list[MaskGrid] | None
    settings: MeasureSettings
    masks_given: bool = False
    rig: RigErrors = NO_ERRORS
    rotation: Float | None = None
    is_sparse: bool = False
    by_network: bool = False

    @classmethod
    def from_detections(
        cls,
        trees: TreeDetections,
        depth_m: Float,
        camera: PinholeCamera,
        masks: Sequence[Bool] | Bool | None,
        settings: MeasureSettings,
    ) -> DepthFrame:
        """Build a frame; `masks` of image size take precedence over those of the detections."""
        grids = None
        if masks is not None:
            grids = [MaskGrid.from_image(mask) for mask in masks]
        elif trees.masks is not None:
            boxes = trees.boxes_px.astype(np.float64)
            grids = [MaskGrid(*pair) for pair in zip(trees.masks, boxes, strict=True)]
        given = masks is not None
        return cls(
            camera,
            np.ascontiguousarray(depth_m),
            grids,
            settings,
            masks_given=given,
            by_network=trees.by_network and not given,
        )

    @cached_property
    def steps(self) -> DepthSteps:
        """The steps of the depth."""
        return depth_steps(self.depth_m)

    @property
    def limits_px(self) -> tuple[Float, Float]:
        """(2,) lowest and (2,) highest place in the image at which it has pixels."""
        # A point on the border itself lies on no mask, so the stem's own depth there would pass for
        # ground.
        return np.array([0.5, 0.5]), np.array([self.camera.width, self.camera.height]) - 0.5

    @cached_property
    def beams_px(self) -> Float | None:
        """(B, 2) places of all readings of sparse depth, in the order of rows; None of other depth.

        They are the centres of their pixels.
        """
        if not self.is_sparse:
            return None
        rows, columns = np.nonzero(np.isfinite(self.depth_m) & (self.depth_m > 0))
        return np.stack([columns, rows], -1) + 0.5

    def to_camera(self, vectors: Float) -> Float:
        """Vectors (..., 3) of the frame's axes in those of the camera."""
        return vectors if self.rotation is None else np.asarray(vectors @ self.rotation)

    def from_camera(self, vectors: Float) -> Float:
        """Vectors (..., 3) of the camera's axes in those of the frame."""
        return vectors if self.rotation is None else np.asarray(vectors @ self.rotation.T)

    @cached_property
    def _to_cells(self) -> Float:
        """(2, 2, T, 1, 1) of x and y the factors and summands of all masks, see `MaskGrid`."""
        to_cells = np.array([mask.to_cells for mask in self.masks or ()])
        return to_cells.transpose(1, 2, 0)[..., None, None]

    def mask_probability(self, xy_px: Float) -> Float:
        """Mask probability (T, ...) of each tree at its own points (T, ..., 2); 1 without masks."""
        if not self.masks:
            return np.ones(xy_px.shape[:-1], np.float32)
        flat = xy_px.reshape(len(xy_px), -1, *xy_px.shape[-2:])
        column, row = (
            (flat[..., axis] * factor + summand).astype(np.float32)
            for axis, (factor, summand) in enumerate(self._to_cells)
        )
        found = np.empty(column.shape, np.float32)
        for mask, *places in zip(self.masks, column, row, found, strict=True):
            mask.at(*places)
        return found.reshape(xy_px.shape[:-1])

    def on_any_stem(self, xy_px: Float) -> Bool:
        """(T, N) whether points (T, N, 2) lie on the mask of any tree in the image."""
        result = np.zeros(xy_px[..., 0].size, np.bool_)
        if self.masks:
            x, y = (np.ascontiguousarray(part) for part in xy_px.reshape(-1, 2).T)
            for first in range(0, len(x), _MAX_POINTS):
                part = slice(first, first + _MAX_POINTS)
                result[part] = self._on_any_mask(x[part], y[part])
        return result.reshape(xy_px.shape[:-1])

    @cached_property
    def _whole_masks(self) -> tuple[list[MaskGrid], Float, Float]:
        """The masks before second stems were cut out, their boxes and (2, 2, T) `to_cells`."""
        masks = [cut.whole or cut for cut in self.masks or ()]
        boxes_px = np.array([mask.box_px for mask in masks], np.float64)
        return masks, boxes_px, np.array([mask.to_cells for mask in masks]).transpose(1, 2, 0)

    def _on_any_mask(self, x: Float, y: Float) -> Bool:
        """(N,) whether points x, y (N,) lie on the whole mask of any tree."""
        masks, boxes_px, to_cells = self._whole_masks
        x0, y0, x1, y1 = boxes_px.T[..., None]
        # `np.nonzero` of two axes takes several times as long.
        within = np.flatnonzero((x > x0) & (x < x1) & (y > y0) & (y < y1))
        number = within // len(x)
        point = within - number * len(x)
        (wide, left), (high, top) = to_cells.take(number, -1)
        column = (wide * x[point] + left).astype(np.float32)
        row = (high * y[point] + top).astype(np.float32)
        ends = np.cumsum(np.bincount(number, minlength=len(masks))).tolist()
        found = np.empty_like(column)
        for mask, first, last in zip(masks, [0, *ends], ends, strict=False):
            if last > first:
                part = np.s_[None, first:last]
                mask.at(column[part], row[part], found[part])
        result = np.zeros(len(x), np.bool_)
        result[point[found >= MASK_THRESHOLD]] = True
        return result

    def inside(self, xy_px: Float, margin_px: Float | float = 0.0) -> Bool:
        """(...) whether points (..., 2) are in the image, at least `margin_px` from its border."""
        x, y = xy_px[..., 0], xy_px[..., 1]
        width, height = self.camera.width, self.camera.height
        across = (x >= margin_px) & (x <= width - margin_px)
        return np.asarray(across & (y >= margin_px) & (y <= height - margin_px))

    def readings(self, xy_px: Float) -> tuple[Float, Float]:
        """Sample the depth map at the nearest pixels.

        Args:
            xy_px: (..., 2) image points.

        Returns:
            Rays (..., 3) with z = 1 through the pixels' centres, and depth (...) in metres, 0
            outside the image, without a reading, or beyond `MeasureSettings.max_range_m`.
        """
        column, row = self._pixels(xy_px)
        centres = np.stack([column + 0.5, row + 0.5], -1)
        return pixels_to_rays(self.camera, centres), self._depth_m(xy_px, column, row)

    def depth_at(self, xy_px: Float) -> Float:
        """Depth (...) in metres at image points (..., 2), as from `readings`."""
        return self._depth_m(xy_px, *self._pixels(xy_px))

    def _pixels(self, xy_px: Float) -> tuple[Index, Index]:
        """Columns and rows (...) of the pixels nearest to points (..., 2)."""
        column = np.fmax(np.fmin(xy_px[..., 0], self.camera.width - 1), 0).astype(np.intp)
        row = np.fmax(np.fmin(xy_px[..., 1], self.camera.height - 1), 0).astype(np.intp)
        return column, row

    def _depth_m(self, xy_px: Float, column: Index, row: Index) -> Float:
        depth_m = self.depth_m.take(row * self.camera.width + column).astype(np.float64)
        usable = self.inside(xy_px) & (depth_m > 0) & (depth_m <= self.settings.max_range_m)
        return np.where(usable, depth_m, 0.0)

    @cached_property
    def mask_std_px(self) -> Float:
        """(T,) standard deviation of an edge of each mask, in pixels."""
        masks, settings = self.masks or (), self.settings
        cells = np.array([mask.cell_px for mask in masks])
        if self.masks_given:
            own_px = np.full_like(cells, settings.given_mask_std_px)
        else:
            smallest = settings.mask_std_px * reference_px(self.camera.width)
            if self.by_network:
                side_px = self.steps.side_px
                smallest = network_std_px(settings.mask_std_px, self.camera.width, side_px)
            own_px = np.hypot(smallest, settings.mask_spread * cells)
        return np.asarray(np.hypot(own_px, [mask.edge_std_px for mask in masks]))

    def rays(self, xy_px: Float) -> Float:
        """Rays (..., 3) with z = 1 through image points (..., 2)."""
        return pixels_to_rays(self.camera, xy_px)
