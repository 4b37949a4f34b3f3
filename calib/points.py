"""Between pixels, rays and camera points: x right, y down, z forward, metres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.camera import PinholeCamera
from calib.errors import CameraError
from calib.pixels import image_to_opencv, opencv_to_image

Float = NDArray[np.floating[Any]]

_UNDISTORT_STEPS = 10
_LEAST_DETERMINANT = 0.05
_LONGEST_STEP = 0.3
_WIDEST = 5.0


def _distort(camera: PinholeCamera, x: Float, y: Float) -> tuple[Float, Float]:
    """OpenCV's radial-tangential model on normalised coordinates."""
    k1, k2, p1, p2, k3 = (*camera.distortion, 0.0)[:5]
    squared = x * x + y * y
    radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (squared + 2 * x * x),
        y * radial + p1 * (squared + 2 * y * y) + 2 * p2 * x * y,
    )


def _undistort(camera: PinholeCamera, x: Float, y: Float) -> tuple[Float, Float]:
    """Inverse of ``_distort`` by Newton's method, with bounded steps.

    Far from the centre a model may fold back, so that no point reaches a pixel: such pixels get
    a finite point near the fold.
    """
    k1, k2, p1, p2, k3 = (*camera.distortion, 0.0)[:5]
    u, v = np.clip(x, -_WIDEST, _WIDEST), np.clip(y, -_WIDEST, _WIDEST)
    for _ in range(_UNDISTORT_STEPS):
        moved_x, moved_y = _distort(camera, u, v)
        squared = u * u + v * v
        radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
        slope = 2 * (k1 + squared * (2 * k2 + squared * 3 * k3))
        du_dx = radial + slope * u * u + 2 * p1 * v + 6 * p2 * u
        dv_dy = radial + slope * v * v + 6 * p1 * v + 2 * p2 * u
        mixed = slope * u * v + 2 * p1 * u + 2 * p2 * v
        determinant = np.maximum(du_dx * dv_dy - mixed * mixed, _LEAST_DETERMINANT)
        miss_x, miss_y = x - moved_x, y - moved_y
        step_u = (dv_dy * miss_x - mixed * miss_y) / determinant
        step_v = (du_dx * miss_y - mixed * miss_x) / determinant
        u = np.clip(u + np.clip(step_u, -_LONGEST_STEP, _LONGEST_STEP), -_WIDEST, _WIDEST)
        v = np.clip(v + np.clip(step_v, -_LONGEST_STEP, _LONGEST_STEP), -_WIDEST, _WIDEST)
    return u, v


def pixels_to_rays(camera: PinholeCamera, xy_px: ArrayLike) -> Float:
    """(..., 2) corner-based px to (..., 3) rays with z = 1, distortion removed."""
    centred = image_to_opencv(xy_px)
    x = (centred[..., 0] - camera.cx) / camera.fx
    y = (centred[..., 1] - camera.cy) / camera.fy
    if camera.distortion:
        x, y = _undistort(camera, x, y)
    return np.stack([x, y, np.ones_like(x)], -1)


def pixels_to_points(camera: PinholeCamera, xy_px: ArrayLike, depth_m: ArrayLike) -> Float:
    """(..., 2) corner-based px and (...) metres along z to (..., 3) camera points, metres."""
    return np.asarray(pixels_to_rays(camera, xy_px) * np.asarray(depth_m, np.float64)[..., None])


def project_points(camera: PinholeCamera, points_m: ArrayLike) -> Float:
    """(..., 3) camera points to (..., 2) corner-based px; points at z <= 0 become infinite."""
    points = np.asarray(points_m, np.float64)
    z = points[..., 2]
    ahead = z > 0
    safe = np.where(ahead, z, 1.0)
    x: Float = points[..., 0] / safe
    y: Float = points[..., 1] / safe
    if camera.distortion:
        x, y = _distort(camera, x, y)
    centred = np.stack([x * camera.fx + camera.cx, y * camera.fy + camera.cy], -1)
    return np.where(ahead[..., None], opencv_to_image(centred), np.inf)


def depth_to_points(camera: PinholeCamera, depth_m: NDArray[np.float32]) -> Float:
    """(H, W) metres to (H, W, 3) camera points; pixels without a reading become (0, 0, 0).

    Raises CameraError where the map's size is not the camera's.
    """
    height, width = depth_m.shape
    if (width, height) != (camera.width, camera.height):
        raise CameraError(
            f"the depth map is {width}x{height} px: expected the camera's"
            f" {camera.width}x{camera.height}"
        )
    rows, columns = np.mgrid[0:height, 0:width]
    xy_px = np.stack([columns, rows], -1) + 0.5
    return pixels_to_points(camera, xy_px, depth_m)
