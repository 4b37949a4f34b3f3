"""The samples of an image: twice as dense as its pixels, every second one at a pixel's centre."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import calib
from calib import PinholeCamera
from perceptree.simulator.rendering.view import View

Float = NDArray[np.floating[Any]]

SUPERSAMPLING = 2
_BEYOND_FACE = 0.5


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

    @property
    def distorted(self) -> bool:
        """Whether the image's samples lie elsewhere than the buffer's."""
        return self.columns is not None

    def nearest(self, buffer: NDArray[np.generic]) -> NDArray[np.generic]:
        """The buffer at every pixel's centre: (H, W), never a blend of two surfaces."""
        if self.columns is None or self.rows is None:
            return np.ascontiguousarray(buffer[::SUPERSAMPLING, ::SUPERSAMPLING])
        column = np.rint(self.columns[::SUPERSAMPLING, ::SUPERSAMPLING]).astype(np.intp)
        row = np.rint(self.rows[::SUPERSAMPLING, ::SUPERSAMPLING]).astype(np.intp)
        return np.asarray(
            buffer[np.clip(row, 0, self.height - 1), np.clip(column, 0, self.width - 1)]
        )

    def nearness(self, corners: Float) -> Float:
        """1 / z (H, W) on the rays of a distorted image's pixels, from the faces seen there.

        ``corners`` (H, W, 3, 3) are the faces' projected corners: x, y in samples and 1 / z, which
        is linear over a face. A ray passes up to half a sample beside the sample that it was
        looked up in.
        """
        assert self.columns is not None
        assert self.rows is not None
        x = self.columns[::SUPERSAMPLING, ::SUPERSAMPLING, None] + 0.5
        y = self.rows[::SUPERSAMPLING, ::SUPERSAMPLING, None] + 0.5
        (x0, x1, x2), (y0, y1, y2) = (
            np.moveaxis(corners[..., k], -1, 0)[..., None] for k in (0, 1)
        )
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        area = np.where(area == 0, 1.0, area)
        first = ((x - x2) * (y1 - y2) + (y - y2) * (x2 - x1)) / area
        second = ((x - x2) * (y2 - y0) + (y - y2) * (x0 - x2)) / area
        weights = np.concatenate([first, second, 1 - first - second], -1)
        weights = np.clip(weights, -_BEYOND_FACE, 1 + _BEYOND_FACE)
        return np.asarray((weights * corners[..., 2]).sum(-1) / weights.sum(-1))

    def resample(self, samples: NDArray[np.float32]) -> NDArray[np.float32]:
        """The colours (2H, 2W, 3) of the image's samples, blended from the buffer's."""
        if self.columns is None or self.rows is None:
            return samples
        return np.asarray(
            cv2.remap(
                samples, self.columns, self.rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            ),
            np.float32,
        )


def sample_grid(view: View) -> SampleGrid:
    """The grid of a view. Pixel x (corner-based) lies at ``2 x - 0.5`` samples.

    A distorted image is drawn as a pinhole buffer that covers its rays and then looked up.
    """
    camera = view.intrinsics
    scale = SUPERSAMPLING
    if not camera.distortion:
        return SampleGrid(
            camera.width * scale,
            camera.height * scale,
            camera.fx * scale,
            camera.fy * scale,
            (camera.cx + 0.5) * scale - 0.5,
            (camera.cy + 0.5) * scale - 0.5,
            None,
            None,
        )
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
        width,
        height,
        focal_x,
        focal_y,
        centre_x,
        centre_y,
        (rays[..., 0] * focal_x + centre_x - 0.5).astype(np.float32),
        (rays[..., 1] * focal_y + centre_y - 0.5).astype(np.float32),
    )
