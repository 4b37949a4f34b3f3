"""One frame as the measurement reads it: rays and depth of pixels, outside and inside stems."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera, pixels_to_rays, project_points
from edgetree.detections import TreeDetections
from edgetree.measure.estimates import Failure
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.stem import Readings

__all__ = ["DepthFrame"]

Float = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]

_LEAST_SHARE = 0.05
_MOST_READINGS = 800
_MOST_GROUND_PIXELS = 1600


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """A depth map, its camera, and the stems in it.

    Attributes:
        camera: of this size.
        depth_m: (H, W) float32 metres, 0 where it has no reading.
        masks: per tree its (H, W) pixels; None where the model gives none.
        stems: (H, W) the pixels of any stem.
        settings: assumptions of the measurement.
    """

    camera: PinholeCamera
    depth_m: NDArray[np.float32]
    masks: list[Mask] | None
    stems: Mask
    settings: MeasureSettings

    @classmethod
    def of(
        cls,
        trees: TreeDetections,
        depth_m: NDArray[np.float32],
        camera: PinholeCamera,
        settings: MeasureSettings,
    ) -> DepthFrame:
        """Paste every mask once; readings that are not finite, or out of range, are none."""
        usable = (depth_m > 0) & (depth_m <= settings.max_range_m)
        stems = np.zeros(depth_m.shape, np.bool_)
        masks = None
        if trees.masks is not None:
            masks = [trees.mask(index) for index in range(len(trees))]
            for mask in masks:
                stems |= mask
        return cls(camera, np.where(usable, depth_m, np.float32(0)), masks, stems, settings)

    def stem_readings(self, index: int, box_px: Float) -> Readings | Failure:
        """Depth in the mask of a tree, or in its box where there are no masks."""
        window = self._window(box_px)
        inside = self.depth_m[window] > 0
        if self.masks is not None:
            mask = self.masks[index][window]
            inside &= mask
            # Of a stem without readings its mask still holds a few, of the ground and beside it.
            if np.count_nonzero(inside) < _LEAST_SHARE * np.count_nonzero(mask):
                return Failure("no depth on the stem")
        step = max(1, int(np.sqrt(np.count_nonzero(inside) / _MOST_READINGS)))
        rows, columns = np.nonzero(inside[::step, ::step])
        cell_px = self.settings.depth_correlation_px / step
        across = int(inside.shape[1] / cell_px) + 1
        cell = (rows / cell_px).astype(np.intp) * across + (columns / cell_px).astype(np.intp)
        return Readings(*self._look(window, rows * step, columns * step), cell)

    def ground_points(self, axis_point: Float, reach_m: float) -> Float:
        """(N, 3) camera points outside the stems, around a point (3,) in the picture."""
        if axis_point[2] <= 0:
            return np.zeros((0, 3))
        x, y = project_points(self.camera, axis_point)
        reach_px = self.camera.fx * reach_m / axis_point[2]
        window = self._window(np.array([x - reach_px, y - reach_px, x + reach_px, y + reach_px]))
        depth_m = self.depth_m[window]
        step = max(1, int(np.sqrt(depth_m.size / _MOST_GROUND_PIXELS)))
        outside = (depth_m[::step, ::step] > 0) & ~self.stems[window][::step, ::step]
        rows, columns = np.nonzero(outside)
        rays, depths_m = self._look(window, rows * step, columns * step)
        return np.asarray(rays * depths_m[:, None])

    def _window(self, box_px: Float) -> tuple[slice, slice]:
        """The pixels of the image that a box (4,) covers."""
        height, width = self.depth_m.shape
        x0, x1 = np.clip([np.floor(box_px[0]), np.ceil(box_px[2])], 0, width).astype(int)
        y0, y1 = np.clip([np.floor(box_px[1]), np.ceil(box_px[3])], 0, height).astype(int)
        return slice(y0, max(y0, y1)), slice(x0, max(x0, x1))

    def _look(
        self, window: tuple[slice, slice], rows: NDArray[np.intp], columns: NDArray[np.intp]
    ) -> tuple[Float, Float]:
        """Rays (N, 3) and depth (N,) of pixels of a window."""
        y, x = rows + window[0].start, columns + window[1].start
        rays = pixels_to_rays(self.camera, np.stack([x, y], -1) + 0.5)
        return rays, self.depth_m[y, x].astype(np.float64)
