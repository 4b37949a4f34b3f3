"""What captures of phones have in common: small depth beside a large picture, and ARKit's poses.

The depth of a phone's lidar is interpolated from 24 x 24 points to 256 x 192 px, in the view of the
colour camera, so that its readings share errors over about ten of its pixels. Pictures are larger
by a factor that is no whole number. They are reduced by whole factors, and the depth takes the
nearest reading: values in between would be of no surface.
"""

from __future__ import annotations

import logging
from abc import abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from basetree.counts import counted
from basetree.errors import InputError
from edgetree.frames.frame import DepthNoise, Frame
from edgetree.frames.rig import Rig
from edgetree.sources.arrays import metres_from_array
from edgetree.sources.source import BaseSource

_log = logging.getLogger(__name__)

LEAST_CONFIDENCE: Final = 1
"""Of 0 (low), 1 and 2 (high), as ARKit gives it; readings of 0 are guesses across edges."""

MOST_FRAMES: Final = 200_000
_LARGEST_SIDE_PX: Final = 1280
_POINT_PITCH_PX: Final = 10.0  # 256 px for 24 points, in pixels of the depth
_ASPECT_TOLERANCE: Final = 0.02
_Z_UP: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


class PhoneFrame(NamedTuple):
    """One frame as its capture stores it.

    Attributes:
        name: Name of the frame.
        image: (H, W, 3) uint8 BGR.
        depth: (h, w) integers in millimetres or floating point in metres.
        confidence: (h, w) uint8, 0 to 2; None if it is not stored.
        camera: Intrinsics of the picture, of any size of the same shape; None if not stored.
        time_s: Time stamp, s.
        pose: Camera to a fixed frame with z up; None if not stored.
        has_gravity: Whether z of that frame is away from gravity.
    """

    name: str
    image: NDArray[np.uint8]
    depth: NDArray[Any]
    confidence: NDArray[np.uint8] | None
    camera: calib.PinholeCamera | None
    time_s: float
    pose: calib.RigidTransform | None
    has_gravity: bool


class Capture(BaseSource):
    """The frames of a capture. Those that cannot be read are left out and counted.

    Args:
        path: The capture.
        rig: Unit and correction of the depth, and cameras that take the place of the capture's.
        count: Number of frames.
    """

    def __init__(self, path: Path, rig: Rig, count: int) -> None:
        super().__init__(str(path))
        if not 1 <= count <= MOST_FRAMES:
            raise InputError(
                f"capture {path} has {counted(count, 'frame')}: expected 1 to {MOST_FRAMES}"
            )
        self.count = count
        self._path, self._rig = path, rig
        self._said_reduced = False

    @abstractmethod
    def _stored(self) -> Iterator[PhoneFrame | InputError]:
        """The frames in their order, or why one cannot be read."""

    def __iter__(self) -> Iterator[Frame]:
        for number, stored in enumerate(self._stored()):
            if self._is_closed.is_set():
                return
            try:
                if isinstance(stored, InputError):
                    raise stored
                yield self._frame(number, stored)
            except InputError as error:
                self.counts["unreadable images"] += 1
                _log.warning("%s", error)

    def _frame(self, number: int, stored: PhoneFrame) -> Frame:
        name = f"frame {stored.name} of {self._path}"
        image = self._reduced(stored.image)
        size_px = (image.shape[1], image.shape[0])
        camera = self._rig.camera_for(*size_px)
        if camera is None and stored.camera is not None:
            camera = stored.camera.scaled(*size_px)
        depth, confidence = _of_one_size(stored, name, size_px)
        reading = metres_from_array(depth, self._rig.depth_convention, f"depth of {name}", camera)
        depth_m = reading.depth_m
        if confidence is not None:
            depth_m = calib.mask_by_confidence(depth_m, confidence, LEAST_CONFIDENCE)
        up_camera = None
        if stored.pose is None or not stored.has_gravity:
            self.counts["without gravity"] += 1
        else:
            up_camera = stored.pose.rotation[2]
        self.counts["without pose"] += stored.pose is None
        pitch_px = _POINT_PITCH_PX * size_px[0] / stored.depth.shape[1]
        return Frame(
            stored.name,
            self._path,
            image,
            depth_m,
            reading.fault,
            stored.time_s,
            number,
            camera,
            up_camera,
            stored.pose,
            DepthNoise(correlation_px=pitch_px),
        )

    def _reduced(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """A picture reduced by a whole factor, if it is large."""
        height, width = image.shape[:2]
        factor = -(-max(width, height) // _LARGEST_SIDE_PX)
        if factor == 1:
            return image
        small_px = (width // factor, height // factor)
        if not self._said_reduced:
            self._said_reduced = True
            _log.warning(
                "pictures of %s are reduced from %dx%d to %dx%d px, in which results are given",
                *(self._path, width, height, *small_px),
            )
        return np.asarray(cv2.resize(image, small_px, interpolation=cv2.INTER_AREA), np.uint8)


def _of_one_size(
    stored: PhoneFrame, name: str, size_px: tuple[int, int]
) -> tuple[NDArray[Any], NDArray[np.uint8] | None]:
    """Depth and confidence in the pixels of the picture, by the nearest reading."""
    depth, confidence = stored.depth, stored.confidence
    if confidence is not None and confidence.shape != depth.shape:
        raise InputError(
            f"{name}: the confidence is {confidence.shape[::-1]} px: expected {depth.shape[::-1]}"
            " px, like the depth"
        )
    height, width = depth.shape
    shape = width * size_px[1] / (height * size_px[0])
    if abs(shape - 1) > _ASPECT_TOLERANCE:
        raise InputError(
            f"{name}: the depth is {width}x{height} px and the picture {size_px[0]}x{size_px[1]}"
            " px: expected the same shape, as they show the same view"
        )
    return _nearest(depth, size_px), None if confidence is None else _nearest(confidence, size_px)


def _nearest(values: NDArray[Any], size_px: tuple[int, int]) -> NDArray[Any]:
    """Values at the nearest pixels of a map of another size."""
    rows, columns = (
        ((np.arange(count) + 0.5) * size / count).astype(np.intp)
        for count, size in zip(size_px[::-1], values.shape, strict=True)
    )
    return values[np.ix_(rows, columns)]


def stored_pose(quaternion_xyzw: ArrayLike, position_m: ArrayLike) -> calib.RigidTransform:
    """A pose as it is stored, whose quaternion may have rounded numbers.

    Args:
        quaternion_xyzw: (4,) rotation from the camera to the world.
        position_m: (3,) position of the camera.

    Raises:
        InputError: It is no rotation, or the position is no number.
    """
    quaternion = np.asarray(quaternion_xyzw, np.float64)
    length = float(np.linalg.norm(quaternion))
    if not 0.9 < length < 1.1:
        raise InputError(f"the pose has the quaternion {quaternion.tolist()}: expected length 1")
    return calib.RigidTransform.from_quaternion(quaternion / length, position_m)


def with_z_up(
    pose: calib.RigidTransform, axes: NDArray[np.float64] | None = None
) -> calib.RigidTransform:
    """A pose in a world with y up, such as ARKit's, as a transform to a frame with z up.

    Args:
        pose: From the axes of the capture's camera to the world.
        axes: (3, 3) rotation from our camera's axes (x right, y down, z forward) to the capture's;
            None if they are the same.
    """
    rotation = pose.rotation if axes is None else pose.rotation @ axes
    return calib.RigidTransform(_Z_UP @ rotation, _Z_UP @ pose.translation_m)
