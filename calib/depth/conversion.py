"""Convert between depth along z, stereo disparity, and range along the ray."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basetree.arrays import Float32
from calib.camera import PinholeCamera
from calib.errors import DepthError
from calib.points import check_size, image_rays


def disparity_to_depth(disparity_px: ArrayLike, fx_px: float, baseline_m: float) -> Float32:
    """Convert stereo disparity to depth: z = fx b / d.

    Args:
        disparity_px: (H, W) disparity of a rectified stereo pair in px; values that are not above 0
            are missing.
        fx_px: Focal length of the rectified pair in px.
        baseline_m: Distance between the two cameras in metres.

    Returns:
        (H, W) float32 metres along z, 0 where the disparity is missing.

    Raises:
        DepthError: If `fx_px` or `baseline_m` is not above 0.

    Examples:
        >>> disparity_to_depth([[42.0, 0.0]], fx_px=700.0, baseline_m=0.12)  # 0: no match
        array([[2., 0.]], dtype=float32)
    """
    return _divide_valid(_focal_baseline(fx_px, baseline_m), disparity_px)


def depth_to_disparity(depth_m: ArrayLike, fx_px: float, baseline_m: float) -> Float32:
    """Convert (H, W) metres along z to (H, W) px; inverse of `disparity_to_depth`."""
    return _divide_valid(_focal_baseline(fx_px, baseline_m), depth_m)


def range_to_depth(range_m: ArrayLike, camera: PinholeCamera) -> Float32:
    """Convert distance along each pixel's ray to depth along z.

    Args:
        range_m: (H, W) metres along the ray, 0 for no reading.
        camera: Camera of the map.

    Returns:
        (H, W) float32 metres along z, 0 for no reading.

    Raises:
        CameraError: If the map does not have the camera's size.

    Examples:
        >>> import numpy as np
        >>> from calib import PinholeCamera, range_to_depth
        >>> camera = PinholeCamera(64, 48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
        >>> depth_m = range_to_depth(np.full((48, 64), 5.0, np.float32), camera)
        >>> round(float(depth_m[0, 0]), 2)  # at a corner, depth is less than range
        4.18
    """
    ranges = np.asarray(range_m, np.float64)
    return np.asarray(ranges / _ray_lengths(camera, ranges), np.float32)


def depth_to_range(depth_m: ArrayLike, camera: PinholeCamera) -> Float32:
    """Convert (H, W) metres along z to metres along the ray; inverse of `range_to_depth`."""
    depths = np.asarray(depth_m, np.float64)
    return np.asarray(depths * _ray_lengths(camera, depths), np.float32)


def _ray_lengths(camera: PinholeCamera, values: NDArray[Any]) -> NDArray[Any]:
    """Return the (H, W) lengths of the rays with z = 1."""
    check_size(camera, values)
    x, y = image_rays(camera)
    return np.asarray(np.sqrt(1 + x * x + y * y))


def _focal_baseline(fx_px: float, baseline_m: float) -> float:
    """Return fx b of a stereo pair after checking both values."""
    for name, value in (("fx_px", fx_px), ("baseline_m", baseline_m)):
        if not (math.isfinite(value) and value > 0):
            raise DepthError(f"{name} is {value}: expected a positive number")
    return fx_px * baseline_m


def _divide_valid(product: float, values: ArrayLike) -> Float32:
    """Divide `product` by the finite values above 0; return 0 elsewhere."""
    divisors = np.asarray(values, np.float64)
    usable = np.isfinite(divisors) & (divisors > 0)
    quotients = np.divide(product, divisors, out=np.zeros(divisors.shape), where=usable)
    return quotients.astype(np.float32)
