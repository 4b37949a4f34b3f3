"""Convert between pixels, rays and camera points (x right, y down, z forward, metres)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float
from calib.camera import PinholeCamera
from calib.distortion import distort, undistort
from calib.errors import CameraError

_BLOCK = 8192  # points per block: small enough for the processor's cache
_CACHED_CAMERAS = 4


def pixels_to_rays(camera: PinholeCamera, xy_px: ArrayLike) -> Float:
    """Convert pixels to rays with the distortion removed.

    Args:
        camera: Camera of the pixels.
        xy_px: (..., 2) continuous px.

    Returns:
        (..., 3) rays (x / z, y / z, 1). Where the distortion model is not invertible, the ray is
        one near the limit; rays of a fisheye are at most 89 degrees off the axis.
    """
    pixels = np.asarray(xy_px, np.float64)
    flat: Float = pixels.reshape(-1, 2)
    rays = np.ones((len(flat), 3))
    for start in range(0, len(flat), _BLOCK):
        block = slice(start, start + _BLOCK)
        x: Float = (flat[block, 0] - 0.5 - camera.cx) / camera.fx
        y: Float = (flat[block, 1] - 0.5 - camera.cy) / camera.fy
        if camera.distortion:
            x, y = undistort(camera.lens, x, y)
        rays[block, 0], rays[block, 1] = x, y
    return rays.reshape(*pixels.shape[:-1], 3)


def pixels_to_points(camera: PinholeCamera, xy_px: ArrayLike, depth_m: ArrayLike) -> Float:
    """Convert pixels with depth to camera points.

    Args:
        camera: Camera of the pixels.
        xy_px: (..., 2) continuous px.
        depth_m: (...) metres along z.

    Returns:
        (..., 3) camera points in metres.

    Examples:
        >>> from calib import PinholeCamera, pixels_to_points
        >>> camera = PinholeCamera(1280, 720, fx=700.0, fy=700.0, cx=639.5, cy=359.5)
        >>> pixels_to_points(camera, [[990.0, 360.0]], [7.0])  # 7 m along the optical axis
        array([[3.5, 0. , 7. ]])
    """
    return np.asarray(pixels_to_rays(camera, xy_px) * np.asarray(depth_m, np.float64)[..., None])


def project_points(camera: PinholeCamera, points_m: ArrayLike) -> Float:
    """Project (..., 3) camera points to (..., 2) continuous px; infinite where z <= 0.

    Examples:
        >>> from calib import PinholeCamera, project_points
        >>> camera = PinholeCamera(1280, 720, fx=700.0, fy=700.0, cx=639.5, cy=359.5)
        >>> project_points(camera, [[3.5, 0.0, 7.0]])
        array([[990., 360.]])
    """
    points = np.asarray(points_m, np.float64)
    flat = points.reshape(-1, 3)
    pixels = np.empty((len(flat), 2))
    for start in range(0, len(flat), _BLOCK):
        block = slice(start, start + _BLOCK)
        _project(camera, flat[block], pixels[block])
    return pixels.reshape(*points.shape[:-1], 2)


def _project(camera: PinholeCamera, points: Float, pixels: Float) -> None:
    """Write the px of (N, 3) `points` to the (N, 2) array `pixels`."""
    z = points[:, 2]
    ahead = z > 0
    all_ahead = bool(ahead.all())
    if not all_ahead:
        z = np.where(ahead, z, 1.0)
    x: Float = points[:, 0] / z
    y: Float = points[:, 1] / z
    if camera.distortion:
        x, y = distort(camera.lens, x, y)
    x *= camera.fx
    x += camera.cx
    y *= camera.fy
    y += camera.cy
    np.add(x, 0.5, out=pixels[:, 0])
    np.add(y, 0.5, out=pixels[:, 1])
    if not all_ahead:
        pixels[~ahead] = np.inf


@lru_cache(maxsize=_CACHED_CAMERAS)
def image_rays(camera: PinholeCamera) -> tuple[Float, Float]:
    """Return x / z and y / z of the rays of all pixel centres.

    The arrays are read-only, cached, and broadcast to (H, W).
    """
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


def depth_to_points(camera: PinholeCamera, depth_m: Float) -> Float:
    """Convert a depth map to camera points.

    Args:
        camera: Camera of the map.
        depth_m: (H, W) metres along z, 0 for no reading.

    Returns:
        (H, W, 3) camera points in metres; (0, 0, 0) for pixels without a reading.

    Raises:
        CameraError: If the map does not have the camera's size.

    Examples:
        >>> import numpy as np
        >>> from calib import PinholeCamera, depth_to_points
        >>> camera = PinholeCamera(64, 48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
        >>> points_m = depth_to_points(camera, np.full((48, 64), 3.0, np.float32))
        >>> points_m[24, 62].round(3)
        array([1.525, 0.025, 3.   ])
    """
    check_size(camera, depth_m)
    x, y = image_rays(camera)
    points = np.empty((camera.height, camera.width, 3))
    np.multiply(x, depth_m, out=points[..., 0])
    np.multiply(y, depth_m, out=points[..., 1])
    points[..., 2] = depth_m
    return points


def check_size(camera: PinholeCamera, depth_m: Float) -> None:
    """Check that an (H, W) depth map has the camera's size.

    Raises:
        CameraError: If it does not.
    """
    if depth_m.shape != (camera.height, camera.width):
        found = "x".join(str(side) for side in reversed(depth_m.shape))
        raise CameraError(
            f"the depth map is {found} px: expected the camera's {camera.width}x{camera.height}"
        )
