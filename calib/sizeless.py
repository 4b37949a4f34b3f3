"""Cameras whose file does not say how large their images are."""

from __future__ import annotations

import logging
from functools import lru_cache

from calib.camera import PinholeCamera
from calib.errors import CameraError
from calib.plausibility import LARGEST_PX

_log = logging.getLogger(__name__)
_FARTHEST_CENTRE = 0.2  # of the sides: farther off, the camera is for another size


class SizelessCamera(PinholeCamera):
    """A camera for images of the size that it was calibrated with, which is not known.

    `width` and `height` are twice the principal point, until `scaled` tells the size of the images.
    Make one with `sizeless_camera`.
    """

    def scaled(self, width: int, height: int) -> PinholeCamera:
        """Return the camera of images of `width` x `height` px: with this size and nothing scaled.

        Raises:
            CameraError: If the camera cannot be for images of this size, because its principal
                point is far from their middle.
        """
        return _of_size(self, width, height)


def sizeless_camera(
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    distortion: tuple[float, ...],
    distortion_model: str,
) -> SizelessCamera:
    """Create a camera of an unknown size; arguments as for `PinholeCamera`.

    Raises:
        CameraError: If a value is invalid.
    """
    sides = []
    for name, centre in (("cx", cx), ("cy", cy)):
        if not 0 < centre < LARGEST_PX / 2:
            raise CameraError(
                f"{name} is {centre} and the image size is not given: expected a point inside the"
                " image"
            )
        sides.append(max(1, round(2 * centre + 1)))
    return SizelessCamera(*sides, fx, fy, cx, cy, distortion, distortion_model)


@lru_cache(maxsize=16)
def _of_size(camera: SizelessCamera, width: int, height: int) -> PinholeCamera:
    for name, centre, side in (("cx", camera.cx, width), ("cy", camera.cy, height)):
        if abs(centre + 0.5 - side / 2) > _FARTHEST_CENTRE * side:
            raise CameraError(
                f"{name} is {centre:g} px and the file of the camera gives no image size, so that"
                f" it is not for images of {width}x{height} px: expected images of the size that"
                " it was calibrated with; add the size to the file"
            )
    sized = PinholeCamera(
        width,
        height,
        *(camera.fx, camera.fy, camera.cx, camera.cy),
        camera.distortion,
        camera.distortion_model,
    )
    for line in sized.unusual_values():
        _log.warning("%s", line)
    return sized
