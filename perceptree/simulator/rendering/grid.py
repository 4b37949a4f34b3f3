"""The sample grid of an image: twice its resolution, with every second sample at a pixel centre."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

import calib
from basetree.arrays import Float, Float32
from calib import PinholeCamera
from perceptree.simulator.rendering.view import View

SUPERSAMPLING = 2
_BEYOND_FACE = 0.5  # how far 1 / z is extrapolated beyond a face, in barycentric weights


@dataclass(frozen=True)
class SampleGrid:
    """A pinhole buffer of samples, from which the samples of a distorted image are interpolated.

    Attributes:
        width: Columns of the buffer.
        height: Rows of the buffer.
        focal_x: Horizontal focal length, samples.
        focal_y: Vertical focal length, samples.
        centre_x: Principal point, samples from the left edge of the buffer.
        centre_y: Principal point, samples from the upper edge of the buffer.
        columns: (2H, 2W) float32, column in the buffer of each image sample; None without
            distortion, where buffer and image samples are the same.
        rows: (2H, 2W) float32, row in the buffer of each image sample; None without distortion.
    """

    width: int
    height: int
    focal_x: float
    focal_y: float
    centre_x: float
    centre_y: float
    columns: Float32 | None
    rows: Float32 | None

    @property
    def distorted(self) -> bool:
        """Whether the camera has distortion, so that image samples differ from buffer samples."""
        return self.columns is not None

    def nearest(self, buffer: NDArray[np.generic]) -> NDArray[np.generic]:
        """Look up the buffer at every pixel centre without interpolation: (H, W)."""
        if self.columns is None or self.rows is None:
            return np.ascontiguousarray(buffer[::SUPERSAMPLING, ::SUPERSAMPLING])
        column = np.rint(self.columns[::SUPERSAMPLING, ::SUPERSAMPLING]).astype(np.intp)
        row = np.rint(self.rows[::SUPERSAMPLING, ::SUPERSAMPLING]).astype(np.intp)
        return np.asarray(
            buffer[np.clip(row, 0, self.height - 1), np.clip(column, 0, self.width - 1)]
        )

    def nearness(self, corners: Float) -> Float:
        """Compute 1 / z on the exact rays of a distorted image's pixels.

        A pixel's ray passes up to half a sample beside the buffer sample that gives its face.

        Args:
            corners: (H, W, 3, 3) projected corners of the face that each pixel shows: x and y in
                samples, and 1 / z, which is linear over a face.

        Returns:
            (H, W) 1 / z, 1/m.
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

    def resample(self, samples: Float32) -> Float32:
        """Interpolate the colours (2H, 2W, 3) of the image samples from the buffer."""
        if self.columns is None or self.rows is None:
            return samples
        return np.asarray(
            cv2.remap(
                samples, self.columns, self.rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            ),
            np.float32,
        )


def sample_grid(view: View) -> SampleGrid:
    """Make the sample grid of a view.

    Corner-based pixel coordinate x is at `2 x - 0.5` samples. An image with distortion is
    rendered into a pinhole buffer that covers all its rays, and then resampled.
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
