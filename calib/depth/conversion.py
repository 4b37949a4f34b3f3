"""Between depth along z, disparity of a rectified stereo pair, and range along the ray."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.camera import PinholeCamera
from calib.errors import DepthError
from calib.points import check_size, image_rays


def disparity_to_depth(
    disparity_px: ArrayLike, fx_px: float, baseline_m: float
) -> NDArray[np.float32]:
    """(H, W) px between the views of a rectified pair to (H, W) metres along z.

    z = fx b / d. What is not above 0 is no reading. Raises DepthError for a pair without width.
    """
    return _divide(_pair(fx_px, baseline_m), disparity_px)


def depth_to_disparity(depth_m: ArrayLike, fx_px: float, baseline_m: float) -> NDArray[np.float32]:
    """The inverse of ``disparity_to_depth``."""
    return _divide(_pair(fx_px, baseline_m), depth_m)


def range_to_depth(range_m: ArrayLike, camera: PinholeCamera) -> NDArray[np.float32]:
    """(H, W) metres along each pixel's ray to (H, W) metres along z; 0 stays no reading.

    Raises CameraError where the map's size is not the camera's.
    """
    ranges = np.asarray(range_m, np.float64)
    return np.asarray(ranges / _ray_lengths(camera, ranges), np.float32)


def depth_to_range(depth_m: ArrayLike, camera: PinholeCamera) -> NDArray[np.float32]:
    """The inverse of ``range_to_depth``."""
    depths = np.asarray(depth_m, np.float64)
    return np.asarray(depths * _ray_lengths(camera, depths), np.float32)


def _ray_lengths(camera: PinholeCamera, values: NDArray[Any]) -> NDArray[Any]:
    """(H, W) lengths of the rays with z = 1."""
    check_size(camera, values)
    x, y = image_rays(camera)
    return np.asarray(np.sqrt(1 + x * x + y * y))


def _pair(fx_px: float, baseline_m: float) -> float:
    """fx b of a stereo pair."""
    for name, value in (("fx_px", fx_px), ("baseline_m", baseline_m)):
        if not (math.isfinite(value) and value > 0):
            raise DepthError(f"{name} is {value}: expected a positive number")
    return fx_px * baseline_m


def _divide(product: float, values: ArrayLike) -> NDArray[np.float32]:
    """``product`` over what is finite and above 0; 0 elsewhere."""
    divisors = np.asarray(values, np.float64)
    usable = np.isfinite(divisors) & (divisors > 0)
    quotients = np.divide(product, divisors, out=np.zeros(divisors.shape), where=usable)
    return quotients.astype(np.float32)
