"""What took the frames: a camera, the depth camera beside it, and how they are mounted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import calib
from edgetree.errors import InputError

__all__ = ["DepthReading", "Rig"]

_UNIT_M = 0.001


class DepthReading(NamedTuple):
    """Depth as the camera of the images sees it, and why it is not to be believed, if so."""

    depth_m: NDArray[np.float32]
    fault: str | None


@dataclass(frozen=True, eq=False)
class Rig:
    """What is known of the cameras; nothing, if nothing is given.

    Attributes:
        camera: what took the images; without it there are no metres.
        up_camera: direction away from gravity in its frame, as an IMU gives it.
        mounting: from the camera's frame to the machine's (x forward, y left, z up).
        depth_camera: what took the depth; None if depth files are in the camera's own pixels.
        depth_extrinsics: from the depth camera's frame to the camera's; None if they are one.
        depth_scale_m: metres of one unit of a depth file.
        depth_calibration: what corrects its metres; None where they are right.

    Raises:
        InputError: values that contradict each other, or a scale that is not positive.
    """

    camera: calib.PinholeCamera | None = None
    up_camera: tuple[float, float, float] | None = None
    mounting: calib.RigidTransform | None = None
    depth_camera: calib.PinholeCamera | None = None
    depth_extrinsics: calib.RigidTransform | None = None
    depth_scale_m: float = _UNIT_M
    depth_calibration: calib.DepthScale | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.depth_scale_m) and self.depth_scale_m > 0):
            raise InputError(
                f"--depth-scale is {self.depth_scale_m}: expected metres per step, above 0"
            )
        if self.depth_camera is not None and self.camera is None:
            raise InputError(
                "--depth-camera given without --camera: expected both, to register depth"
            )
        if self.depth_extrinsics is not None and self.depth_camera is None:
            raise InputError(
                "--depth-extrinsics given without --depth-camera: expected the camera they are for"
            )

    def camera_for(self, width: int, height: int) -> calib.PinholeCamera | None:
        """The camera for images of this size.

        Raises:
            CameraError: its own have another aspect.
        """
        return None if self.camera is None else _of_size(self.camera, width, height)

    def read_depth(
        self, path: Path, image: Path | None = None, size_px: tuple[int, int] | None = None
    ) -> DepthReading:
        """Read a depth file, in the pixels of an image.

        Args:
            path: the depth file.
            image: the image that it belongs to; None if depth is all there is.
            size_px: width and height of that image.

        Raises:
            InputError: the file is of another size than the image and no depth camera is known.
            CalibError: the file cannot be read, or a camera is for another aspect.
        """
        depth_m = calib.read_depth(path, scale=self.depth_scale_m)
        if self.depth_calibration is not None:
            depth_m = self.depth_calibration.apply(depth_m)
        check = calib.check_depth(depth_m)
        fault = f"depth {path}: {check.reason}" if isinstance(check, calib.DepthFailure) else None
        if size_px is None:
            return DepthReading(depth_m, fault)
        height, width = depth_m.shape
        if self.depth_camera is not None:
            own = _depth_camera_of(self.depth_camera, path, width, height)
            return DepthReading(self._registered(depth_m, own, size_px), fault)
        if (width, height) != size_px:
            hint = "; pass --depth-camera if another camera took it" if self.camera else ""
            raise InputError(
                f"depth {path} is {width}x{height} px: expected {size_px[0]}x{size_px[1]} px, as"
                f" image {image}{hint}"
            )
        return DepthReading(depth_m, fault)

    def _registered(
        self,
        depth_m: NDArray[np.float32],
        depth_camera: calib.PinholeCamera,
        size_px: tuple[int, int],
    ) -> NDArray[np.float32]:
        """Depth moved from the depth camera's pixels to the camera's."""
        camera = self.camera_for(*size_px)
        assert camera is not None
        transform = self.depth_extrinsics or calib.RigidTransform.identity()
        return calib.register_depth(depth_m, depth_camera, camera, transform)


def _depth_camera_of(
    camera: calib.PinholeCamera, path: Path, width: int, height: int
) -> calib.PinholeCamera:
    """The depth camera for maps of the size of this file's; an error names both."""
    try:
        return _of_size(camera, width, height)
    except calib.CameraError as error:
        raise calib.CameraError(
            f"depth {path} is {width}x{height} px: expected the aspect of --depth-camera,"
            f" {camera.width}x{camera.height} px"
        ) from error


def _of_size(camera: calib.PinholeCamera, width: int, height: int) -> calib.PinholeCamera:
    same = (camera.width, camera.height) == (width, height)
    return camera if same else camera.scaled(width, height)
