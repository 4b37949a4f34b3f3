"""Between pixels, rays and camera points: x right, y down, z forward, metres."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.camera import PinholeCamera
from calib.distortion import distort, undistort
from calib.errors import CameraError

Float = NDArray[np.floating[Any]]

_BLOCK = 8192  # points whose temporaries stay in the processor's cache
_KEPT_CAMERAS = 4


def pixels_to_rays(camera: PinholeCamera, xy_px: ArrayLike) -> Float:
    """(..., 2) corner-based px to (..., 3) rays with z = 1, distortion removed.

    Where the lens model folds back and no ray reaches a pixel, the ray is one near the fold. A
    fisheye's rays are at most 89 degrees off the axis.
    """
    pixels = np.asarray(xy_px, np.float64)
    flat: Float = pixels.reshape(-1, 2)
    rays = np.ones((len(flat), 3))
    for start in range(0, len(flat), _BLOCK):
        block = slice(start, start + _BLOCK)
        x: Float = (flat[block, 0] - 0.5 - camera.cx) / camera.fx
        y: Float = (flat[block, 1] - 0.5 - camera.cy) / camera.fy
        if camera.distortion:
            x, y = undistort(camera, x, y)
        rays[block, 0], rays[block, 1] = x, y
    return rays.reshape(*pixels.shape[:-1], 3)


def pixels_to_points(camera: PinholeCamera, xy_px: ArrayLike, depth_m: ArrayLike) -> Float:
    """(..., 2) corner-based px and (...) metres along z to (..., 3) camera points, metres."""
    return np.asarray(pixels_to_rays(camera, xy_px) * np.asarray(depth_m, np.float64)[..., None])


def project_points(camera: PinholeCamera, points_m: ArrayLike) -> Float:
    """(..., 3) camera points to (..., 2) corner-based px; points at z <= 0 become infinite."""
    points = np.asarray(points_m, np.float64)
    flat = points.reshape(-1, 3)
    pixels = np.empty((len(flat), 2))
    for start in range(0, len(flat), _BLOCK):
        block = slice(start, start + _BLOCK)
        _project(camera, flat[block], pixels[block])
    return pixels.reshape(*points.shape[:-1], 2)


def _project(camera: PinholeCamera, points: Float, pixels: Float) -> None:
    """Fill (N, 2) ``pixels`` with those of (N, 3) ``points``."""
    z = points[:, 2]
    ahead = z > 0
    all_ahead = bool(ahead.all())
    if not all_ahead:
        z = np.where(ahead, z, 1.0)
    x: Float = points[:, 0] / z
    y: Float = points[:, 1] / z
    if camera.distortion:
        x, y = distort(camera, x, y)
    x *= camera.fx
    x += camera.cx
    y *= camera.fy
    y += camera.cy
    np.add(x, 0.5, out=pixels[:, 0])
    np.add(y, 0.5, out=pixels[:, 1])
    if not all_ahead:
        pixels[~ahead] = np.inf


@lru_cache(maxsize=_KEPT_CAMERAS)
def image_rays(camera: PinholeCamera) -> tuple[Float, Float]:
    """x and y of the rays with z = 1 of all pixel centres, read-only; they broadcast to (H, W)."""
    columns, rows = np.arange(camera.width), np.arange(camera.height)
    if not camera.distortion:
        x: Float = ((columns - camera.cx) / camera.fx)[None]
        y: Float = ((rows - camera.cy) / camera.fy)[:, None]
    else:
        xy_px = np.empty((camera.height, camera.width, 2))
        xy_px[..., 0], xy_px[..., 1] = columns + 0.5, rows[:, None] + 0.5
        rays = pixels_to_rays(camera, xy_px)
        x, y = rays[..., 0].copy(), rays[..., 1].copy()
    for values in (x, y):
        values.flags.writeable = False
    return x, y


def depth_to_points(camera: PinholeCamera, depth_m: NDArray[np.floating[Any]]) -> Float:
    """(H, W) metres to (H, W, 3) camera points; pixels without a reading become (0, 0, 0).

    Raises CameraError where the map's size is not the camera's.
    """
    check_size(camera, depth_m)
    x, y = image_rays(camera)
    points = np.empty((camera.height, camera.width, 3))
    np.multiply(x, depth_m, out=points[..., 0])
    np.multiply(y, depth_m, out=points[..., 1])
    points[..., 2] = depth_m
    return points


def check_size(camera: PinholeCamera, depth_m: NDArray[np.floating[Any]]) -> None:
    """Raise CameraError where a (H, W) depth map is not of the camera's size."""
    if depth_m.shape != (camera.height, camera.width):
        found = "x".join(str(side) for side in reversed(depth_m.shape))
        raise CameraError(
            f"the depth map is {found} px: expected the camera's {camera.width}x{camera.height}"
        )
