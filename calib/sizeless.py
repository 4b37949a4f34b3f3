"""Cameras whose file does not say how large their images are."""

from __future__ import annotations

import logging
from functools import lru_cache
from typing import Any

from calib.camera import PinholeCamera
from calib.errors import CameraError
from calib.plausibility import LARGEST_PX

_log = logging.getLogger(__name__)
# Scales of pictures, and how far the principal point may then be from their middle, relative to it.
_AS_THEY_ARE = 0.2
_SCALES = ((1, 2), (2, 1), (1, 3), (3, 1), (1, 4), (4, 1), (2, 3), (3, 2))
_SCALED = 0.08


class SizelessCamera(PinholeCamera):
    """A camera for images of the size that it was calibrated with, which is not known.

    `width` and `height` are twice the principal point, until `scaled` tells the size of the images.
    Make one with `sizeless_camera`.
    """

    def scaled(self, width: int, height: int) -> PinholeCamera:
        """Return the camera of images of `width` x `height` px.

        If the principal point is near their middle, nothing is scaled. If it is that of images
        2, 3, 4 or 1.5 times as large or as small, the camera is scaled. A warning says which.

        Raises:
            CameraError: If the principal point is the middle of no such image.
        """
        return _of_size(self, width, height)

    @property
    def has_size(self) -> bool:
        """False."""
        return False

    def cropped(self, x_px: int, y_px: int, width: int, height: int) -> PinholeCamera:
        """Return the camera of a crop of the image, whose size is known then."""
        return PinholeCamera(
            *(width, height, self.fx, self.fy, self.cx - x_px, self.cy - y_px),
            self.distortion,
            self.distortion_model,
        )

    def binned(self, columns: int, rows: int) -> PinholeCamera:
        """Return the camera of images whose pixels are `columns` x `rows` pixels of this one."""
        if min(columns, rows) < 1:
            raise CameraError(f"binning is {columns}x{rows}: expected 1x1 or more")
        centre = ((self.cx + 0.5) / columns - 0.5, (self.cy + 0.5) / rows - 0.5)
        lens = (self.distortion, self.distortion_model)
        return sizeless_camera(self.fx / columns, self.fy / rows, *centre, *lens)

    def _changed(self, **values: Any) -> PinholeCamera:
        raise CameraError(
            "the camera's file does not say how large its images are: expected"
            " camera.scaled(width, height) of the images first"
        )

    def to_dict(self) -> dict[str, Any]:
        """Raise CameraError: what would be written for a size is not known."""
        return self._changed().to_dict()


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
    width, height = sides
    return SizelessCamera(width, height, fx, fy, cx, cy, distortion, distortion_model)


@lru_cache(maxsize=16)
def _of_size(camera: SizelessCamera, width: int, height: int) -> PinholeCamera:
    off = (width / (2 * camera.cx + 1), height / (2 * camera.cy + 1))
    scale = (1, 1) if _near(off, 1, _AS_THEY_ARE) else None
    scale = scale or next((s for s in _SCALES if _near(off, s[0] / s[1], _SCALED)), None)
    if scale is None:
        raise CameraError(
            f"the principal point is ({camera.cx:g}, {camera.cy:g}) px and the file of the camera"
            f" gives no image size, so that it is not for images of {width}x{height} px: expected"
            " images of the size that it was calibrated with; add the size to the file"
        )
    times, parts = scale
    full = PinholeCamera(
        *(round(width * parts / times), round(height * parts / times)),
        *(camera.fx, camera.fy, camera.cx, camera.cy),
        camera.distortion,
        camera.distortion_model,
    )
    how = "as it is" if times == parts else f"scaled by {times}/{parts}"
    _log.warning(
        "the camera without a size is taken %s for pictures of %dx%d px, because its principal"
        " point is near the middle of %dx%d px",
        *(how, width, height, full.width, full.height),
    )
    for line in full.unusual_values():
        _log.warning("%s", line)
    return full.scaled(width, height)


def _near(off: tuple[float, float], scale: float, tolerance: float) -> bool:
    return all(abs(value / scale - 1) <= tolerance for value in off)
