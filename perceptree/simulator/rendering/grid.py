"""The samples of an image: twice as dense as its pixels, every second one at a pixel's centre."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

import calib
from calib import PinholeCamera
from perceptree.simulator.rendering.view import View

SUPERSAMPLING = 2


@dataclass(frozen=True)
class SampleGrid:
    """A pinhole buffer of ``width`` x ``height`` samples; intrinsics in samples, corner-based.

    ``columns`` and ``rows`` (2H, 2W) float32 say where in the buffer each sample of a distorted
    image lies; None where image and buffer are the same.
    """

    width: int
    height: int
    focal_x: float
    focal_y: float
    centre_x: float
    centre_y: float
    columns: NDArray[np.float32] | None
    rows: NDArray[np.float32] | None

    def nearest(self, buffer: NDArray[np.generic]) -> NDArray[np.generic]:
        """The buffer at every pixel's centre: (H, W), never a blend of two surfaces."""
        if self.columns is None or self.rows is None:
            return np.ascontiguousarray(buffer[::SUPERSAMPLING, ::SUPERSAMPLING])
        column = np.rint(self.columns[::SUPERSAMPLING, ::SUPERSAMPLING]).astype(np.intp)
        row = np.rint(self.rows[::SUPERSAMPLING, ::SUPERSAMPLING]).astype(np.intp)
        return np.asarray(buffer[np.clip(row, 0, self.height - 1),
                                 np.clip(column, 0, self.width - 1)])  # fmt: skip

    def resample(self, samples: NDArray[np.float32]) -> NDArray[np.float32]:
        """The colours (2H, 2W, 3) of the image's samples, blended from the buffer's."""
        if self.columns is None or self.rows is None:
            return samples
        return np.asarray(
            cv2.remap(samples, self.columns, self.rows, cv2.INTER_LINEAR,
                      borderMode=cv2.BORDER_REPLICATE), np.float32,
        )  # fmt: skip


def sample_grid(view: View) -> SampleGrid:
    """The grid of a view. Pixel x (corner-based) lies at ``2 x - 0.5`` samples.

    A distorted image is drawn as a pinhole buffer that covers its rays and then looked up.
    """
    camera = view.intrinsics
    scale = SUPERSAMPLING
    if not camera.distortion:
        return SampleGrid(
            camera.width * scale, camera.height * scale, camera.fx * scale, camera.fy * scale,
            (camera.cx + 0.5) * scale - 0.5, (camera.cy + 0.5) * scale - 0.5, None, None,
        )  # fmt: skip
    return _distorted_grid(camera, view.ray_bounds)


@lru_cache(maxsize=4)
def _distorted_grid(camera: PinholeCamera, bounds: tuple[float, float, float, float]) -> SampleGrid:
    scale = SUPERSAMPLING
    left, right, top, bottom = bounds
    focal_x, focal_y = camera.fx * scale, camera.fy * scale
    width = 2 * int(np.ceil((right - left) * focal_x / 2 + 2))
    height = 2 * int(np.ceil((bottom - top) * focal_y / 2 + 2))
    centre_x, centre_y = 2 - left * focal_x, 2 - top * focal_y
    rows, columns = np.mgrid[0 : camera.height * scale, 0 : camera.width * scale]
    pixels = (np.stack([columns, rows], -1) + 1.0) / scale
    rays = calib.pixels_to_rays(camera, pixels)
    return SampleGrid(
        width, height, focal_x, focal_y, centre_x, centre_y,
        (rays[..., 0] * focal_x + centre_x - 0.5).astype(np.float32),
        (rays[..., 1] * focal_y + centre_y - 0.5).astype(np.float32),
    )  # fmt: skip
