"""One frame as the measurement looks at it: depth, masks and rays at points of the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera, pixels_to_rays
from edgetree.detections import TreeDetections
from edgetree.measure.settings import MeasureSettings

__all__ = ["DepthFrame", "MaskGrid"]

Float = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]

_SHOWN = 0.5


@dataclass(frozen=True, eq=False)
class MaskGrid:
    """A mask as probabilities (rows, columns) on equal cells over a box (4,), xyxy px."""

    grid: NDArray[np.float32]
    box_px: Float

    @classmethod
    def of_image(cls, mask: Mask) -> MaskGrid:
        """From an (H, W) bool mask: its cells are the pixels around what it shows."""
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        if not len(rows):
            return cls(np.zeros((1, 1), np.float32), np.zeros(4))
        y0, y1, x0, x1 = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
        return cls(mask[y0:y1, x0:x1].astype(np.float32), np.array([x0, y0, x1, y1], np.float64))

    @property
    def cell_px(self) -> float:
        """Width of a cell."""
        return float(self.box_px[2] - self.box_px[0]) / float(self.grid.shape[1])

    def at(self, xy_px: Float) -> Float:
        """(...) probability at (..., 2) points of the picture, interpolated as masks are pasted."""
        x0, y0, x1, y1 = self.box_px.tolist()
        if not (x1 > x0 and y1 > y0):
            return np.zeros(xy_px.shape[:-1])
        rows, columns = self.grid.shape
        wide, high = columns / (x1 - x0), rows / (y1 - y0)
        flat = xy_px.reshape(-1, xy_px.shape[-2], 2)
        x = cv2.addWeighted(flat[..., 0], wide, flat[..., 0], 0, -x0 * wide - 0.5, dtype=cv2.CV_32F)
        y = cv2.addWeighted(flat[..., 1], high, flat[..., 1], 0, -y0 * high - 0.5, dtype=cv2.CV_32F)
        found = cv2.remap(self.grid, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return np.asarray(found.reshape(xy_px.shape[:-1]))


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """A depth map, its camera, and the stems in it.

    Attributes:
        camera: of this size.
        depth_m: (H, W) metres; 0, NaN and infinities where it has no reading.
        masks: one for each of T trees; None where there are none.
        settings: assumptions of the measurement.
    """

    camera: PinholeCamera
    depth_m: Float
    masks: list[MaskGrid] | None
    settings: MeasureSettings

    @classmethod
    def of(
        cls,
        trees: TreeDetections,
        depth_m: Float,
        camera: PinholeCamera,
        masks: Sequence[Mask] | NDArray[np.bool_] | None,
        settings: MeasureSettings,
    ) -> DepthFrame:
        """Take the masks of image size where there are some, else the grids of the detections."""
        grids = None
        if masks is not None:
            grids = [MaskGrid.of_image(mask) for mask in masks]
        elif trees.masks is not None:
            boxes = trees.boxes_px.astype(np.float64)
            grids = [MaskGrid(*pair) for pair in zip(trees.masks, boxes, strict=True)]
        return cls(camera, depth_m, grids, settings)

    def shown(self, xy_px: Float) -> Float:
        """(T, ...) how much the mask of each tree shows at its own points (T, ..., 2)."""
        result = np.ones(xy_px.shape[:-1], np.float32)
        for mask, own, shown in zip(self.masks or (), xy_px, result, strict=False):
            shown[:] = mask.at(own)
        return result

    def on_any_stem(self, xy_px: Float) -> NDArray[np.bool_]:
        """(T, N) whether points (T, N, 2) lie on the mask of any tree of the picture."""
        result = np.zeros(xy_px.shape[:-1], np.bool_)
        for mask in self.masks or ():
            x0, y0, x1, y1 = mask.box_px
            x, y = xy_px[..., 0], xy_px[..., 1]
            near = (x > x0) & (x < x1) & (y > y0) & (y < y1)
            if near.any():
                result[near] |= mask.at(xy_px[near][None])[0] >= _SHOWN
        return result

    def inside(self, xy_px: Float, margin_px: Float | float = 0.0) -> NDArray[np.bool_]:
        """(...) whether points (..., 2) lie in the picture, so far from its border."""
        x, y = xy_px[..., 0], xy_px[..., 1]
        width, height = self.camera.width, self.camera.height
        across = (x >= margin_px) & (x <= width - margin_px)
        return np.asarray(across & (y >= margin_px) & (y <= height - margin_px))

    def readings(self, xy_px: Float) -> tuple[Float, Float]:
        """Rays (..., 3) through the pixels under points (..., 2), and their depth (...), 0 where
        there is none, or none in range.
        """
        pixel = self._pixels(xy_px)
        return pixels_to_rays(self.camera, pixel + 0.5), self._depth_m(xy_px, pixel)

    def depth_at(self, xy_px: Float) -> Float:
        """(...) depth of the pixels under points (..., 2), as `readings` gives it."""
        return self._depth_m(xy_px, self._pixels(xy_px))

    def _pixels(self, xy_px: Float) -> NDArray[np.intp]:
        limit = np.array([self.camera.width - 1, self.camera.height - 1])
        return np.asarray(np.fmax(np.fmin(xy_px, limit), 0)).astype(np.intp)

    def _depth_m(self, xy_px: Float, pixel: NDArray[np.intp]) -> Float:
        depth_m = self.depth_m[pixel[..., 1], pixel[..., 0]].astype(np.float64)
        usable = self.inside(xy_px) & (depth_m > 0) & (depth_m <= self.settings.max_range_m)
        return np.where(usable, depth_m, 0.0)

    def mask_std_px(self) -> Float:
        """(T,) error of an edge of each mask."""
        cells = np.array([mask.cell_px for mask in self.masks or ()])
        return np.hypot(self.settings.mask_std_px, self.settings.mask_spread * cells)

    def rays(self, xy_px: Float) -> Float:
        """(..., 3) rays with z = 1 through points (..., 2)."""
        return pixels_to_rays(self.camera, xy_px)
