"""Remove the lens distortion from images and depth maps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

import cv2
import numpy as np

from basetree.arrays import Float, Float32, UInt8
from calib.camera import PinholeCamera
from calib.distortion import RADTAN
from calib.errors import CameraError
from calib.pixels import image_to_opencv
from calib.points import check_size, image_rays, pixels_to_rays, project_points

_RAY_TOLERANCE = 1e-6
_OUTSIDE_PX = -10.0


@dataclass(frozen=True, eq=False)
class Rectification:
    """Maps an image of `source` to one without distortion.

    Attributes:
        source: The camera with distortion.
        camera: The camera without distortion, of the rectified image.
        map_x: (H, W) float32 column in the source image of each rectified pixel, for `cv2.remap`.
        map_y: (H, W) float32 row in the source image of each rectified pixel.
    """

    source: PinholeCamera
    camera: PinholeCamera
    map_x: Float32
    map_y: Float32

    def image(self, image: UInt8) -> UInt8:
        """Rectify an image by bilinear interpolation.

        Args:
            image: (H, W) or (H, W, C) uint8 of the source camera.

        Returns:
            The same shape; 0 outside the source image.

        Raises:
            CameraError: If the image does not have the source camera's size.
        """
        height, width = image.shape[:2]
        if (width, height) != (self.source.width, self.source.height):
            raise CameraError(
                f"the image is {width}x{height} px: expected the camera's"
                f" {self.source.width}x{self.source.height}"
            )
        undistorted = cv2.remap(image, self.map_x, self.map_y, cv2.INTER_LINEAR)
        return cast("UInt8", undistorted)

    def depth(self, depth_m: Float) -> Float32:
        """Rectify a depth map by taking the nearest pixel.

        The optical axis is unchanged, so depths along z keep their values.

        Args:
            depth_m: (H, W) metres along z of the source camera.

        Returns:
            (H, W) float32 metres; 0 outside the source map.

        Raises:
            CameraError: If the map does not have the source camera's size.
        """
        check_size(self.source, depth_m)
        metres = np.asarray(depth_m, np.float32)
        undistorted = cv2.remap(metres, self.map_x, self.map_y, cv2.INTER_NEAREST)
        return cast("Float32", undistorted)


def rectify(camera: PinholeCamera, focal_scale: float = 1.0) -> Rectification:
    """Prepare to remove a camera's distortion; size and principal point are kept.

    Args:
        camera: Camera with distortion.
        focal_scale: Focal length of the rectified camera relative to the source. Below 1 more of a
            wide lens's view is kept, above 1 less.

    Raises:
        CameraError: If `focal_scale` is not above 0.
    """
    if not (math.isfinite(focal_scale) and focal_scale > 0):
        raise CameraError(f"focal_scale is {focal_scale}: expected a positive number")
    undistorted = replace(
        camera,
        fx=camera.fx * focal_scale,
        fy=camera.fy * focal_scale,
        distortion=(),
        distortion_model=RADTAN,
        focal_std_px=camera.focal_std_px * focal_scale,
    )
    x, y = np.broadcast_arrays(*image_rays(undistorted))
    pixels = project_points(camera, np.stack([x, y, np.ones_like(x)], -1))
    back = pixels_to_rays(camera, pixels)
    # Far from the centre the model may map two rays to one pixel: drop pixels of another ray.
    same = np.hypot(back[..., 0] - x, back[..., 1] - y) < _RAY_TOLERANCE * (1 + np.hypot(x, y))
    centred = np.where(same[..., None], image_to_opencv(pixels), _OUTSIDE_PX).astype(np.float32)
    maps = (np.ascontiguousarray(centred[..., axis]) for axis in (0, 1))
    return Rectification(camera, undistorted, *maps)
