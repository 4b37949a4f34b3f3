"""Images and depth maps as a camera without a lens's bending would have them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera import RADTAN, PinholeCamera
from calib.errors import CameraError
from calib.pixels import image_to_opencv
from calib.points import check_size, image_rays, pixels_to_rays, project_points

_SAME_RAY = 1e-6
_OUTSIDE = -10.0


@dataclass(frozen=True, eq=False)
class Rectification:
    """The straight ``camera``, and where each of its pixels is in the image of the ``source``.

    ``map_x`` and ``map_y`` (H, W) float32 are what ``cv2.remap`` takes.
    """

    source: PinholeCamera
    camera: PinholeCamera
    map_x: NDArray[np.float32]
    map_y: NDArray[np.float32]

    def image(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W) or (H, W, C) uint8 of the source, bilinear; 0 where it saw nothing.

        Raises CameraError for an image of another size.
        """
        height, width = image.shape[:2]
        if (width, height) != (self.source.width, self.source.height):
            raise CameraError(
                f"the image is {width}x{height} px: expected the camera's"
                f" {self.source.width}x{self.source.height}"
            )
        straight = cv2.remap(image, self.map_x, self.map_y, cv2.INTER_LINEAR)
        return cast("NDArray[np.uint8]", straight)

    def depth(self, depth_m: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
        """(H, W) metres along z of the source: the nearest pixel's; 0 where it saw nothing.

        The optical axis stays, so that depths keep their values. Raises CameraError for a map of
        another size.
        """
        check_size(self.source, depth_m)
        metres = np.asarray(depth_m, np.float32)
        straight = cv2.remap(metres, self.map_x, self.map_y, cv2.INTER_NEAREST)
        return cast("NDArray[np.float32]", straight)


def rectify(camera: PinholeCamera, focal_scale: float = 1.0) -> Rectification:
    """The camera of the same size and principal point without distortion, and the way there.

    A ``focal_scale`` below 1 shows more of what a wide lens sees, above 1 less. Raises
    CameraError for one that is not above 0.
    """
    if not (math.isfinite(focal_scale) and focal_scale > 0):
        raise CameraError(f"focal_scale is {focal_scale}: expected a positive number")
    straight = replace(
        camera,
        fx=camera.fx * focal_scale,
        fy=camera.fy * focal_scale,
        distortion=(),
        distortion_model=RADTAN,
        focal_std_px=camera.focal_std_px * focal_scale,
    )
    x, y = np.broadcast_arrays(*image_rays(straight))
    pixels = project_points(camera, np.stack([x, y, np.ones_like(x)], -1))
    back = pixels_to_rays(camera, pixels)
    # Far out a model may fold back: a pixel that belongs to another ray is none of this one's.
    same = np.hypot(back[..., 0] - x, back[..., 1] - y) < _SAME_RAY * (1 + np.hypot(x, y))
    centred = np.where(same[..., None], image_to_opencv(pixels), _OUTSIDE).astype(np.float32)
    maps = (np.ascontiguousarray(centred[..., axis]) for axis in (0, 1))
    return Rectification(camera, straight, *maps)
