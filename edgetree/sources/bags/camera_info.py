"""Cameras from sensor_msgs/CameraInfo messages."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

import calib
from calib.files import ros
from calib.files.fields import tell_choice

_NO_SIZE: Final = (0, 0)


def camera_of_message(
    message: Any,
    *,
    is_rectified: bool = False,
    size_px: tuple[int, int] = _NO_SIZE,
    is_whole: bool = False,
) -> calib.PinholeCamera:
    """The camera that a CameraInfo message describes.

    Args:
        message: a CameraInfo message of ROS 1 or ROS 2.
        is_rectified: Whether the images are rectified. Their camera is in the matrix P, without
            distortion.
        size_px: Width and height of the pictures, for a message that states none.
        is_whole: Whether the pictures are whole, whatever region the message states.

    Raises:
        CameraError: The message is of an uncalibrated camera or of a lens that is not supported.
    """
    values = _values(message)
    if is_rectified and any(values["p"]):
        fx, _, cx, _, _, fy, cy, *_ = values["p"]
        values |= {"k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], "d": [], "distortion_model": ""}
    if (values["width"], values["height"]) == _NO_SIZE:
        values |= {"width": size_px[0], "height": size_px[1]}
    if is_whole:
        values["roi"] = {}
    return ros.build_message(values)


def _values(message: Any) -> dict[str, Any]:
    """The fields that make the camera; ROS 1 writes the matrices in capitals."""
    matrices = {
        name: [float(value) for value in getattr(message, name, getattr(message, name.upper(), ()))]
        for name in ("k", "d", "r", "p")
    }
    return {
        "width": int(message.width),
        "height": int(message.height),
        "distortion_model": str(message.distortion_model),
        "binning_x": int(message.binning_x),
        "binning_y": int(message.binning_y),
        "roi": {name: int(getattr(message.roi, name)) for name in _REGION},
        **matrices,
    }


_REGION: Final = ("x_offset", "y_offset", "width", "height", "do_rectify")


def may_fit(message: Any, size_px: tuple[int, int] | None) -> bool:
    """Whether a CameraInfo message may be of pictures of a size, which is None if not known."""
    stated = (int(message.width), int(message.height))
    is_part = any((message.roi.width, message.roi.height, message.binning_x, message.binning_y))
    return size_px in (None, stated) or stated == _NO_SIZE or bool(is_part)


def same_lens(first: Any, second: Any) -> bool:
    """Whether two CameraInfo messages state the same."""
    return _values(first) == _values(second)


@dataclass(frozen=True)
class LensChoice:
    """Which lens of a message with distortion was taken.

    Attributes:
        is_rectified: Whether the pictures are called rectified.
        camera: What was taken.
    """

    is_rectified: bool
    camera: calib.PinholeCamera

    def __str__(self) -> str:
        focal = f"focal length {self.camera.fx:.1f} px"
        if self.is_rectified and self.camera.distortion:
            return (
                "called rectified, and P of CameraInfo is 0: its lens is K and D,"
                f" {focal}, with distortion"
            )
        if self.is_rectified:
            return f"called rectified: its lens is P of CameraInfo, {focal}, without distortion"
        return f"not called rectified: its lens is K and D of CameraInfo, {focal}, with distortion"


class CameraInfos:
    """The cameras of one topic, which change if the camera changes its resolution.

    Args:
        is_rectified: Whether the images are rectified.

    Attributes:
        error: Why the last message that differs from the one before cannot be used; None if it can.
        choice: Which lens was taken, if the message has a lens with distortion.
        size_from_pictures: Whether a message states no size, so that it is that of the pictures.
    """

    def __init__(self, *, is_rectified: bool = False) -> None:
        self._is_rectified = is_rectified
        self._key: str | None = None
        self._cameras: dict[tuple[int, int], calib.PinholeCamera] = {}
        self._without_size: Any = None
        self._of_region: Any = None
        self.error: str | None = None
        self.choice: LensChoice | None = None

    @property
    def size_from_pictures(self) -> bool:
        """Whether the newest message states no size."""
        return self._without_size is not None

    def add(self, message: Any) -> None:
        """Take a message. A camera that cannot be used leaves its reason in `error`."""
        key = repr(_values(message))
        if key == self._key:
            return
        self._key = key
        self._without_size = None
        is_binned = max(message.binning_x, message.binning_y) > 1
        self._of_region = message if message.roi.width and not is_binned else None
        if (message.width, message.height) == _NO_SIZE:
            self._without_size = message
            self._cameras.clear()
            return
        camera = self._build(message)
        if camera is not None:
            self._cameras.pop((camera.width, camera.height), None)
            self._cameras[camera.width, camera.height] = camera  # the newest is the last

    def _build(
        self, message: Any, size_px: tuple[int, int] = _NO_SIZE, *, is_whole: bool = False
    ) -> calib.PinholeCamera | None:
        try:
            camera = camera_of_message(
                message, is_rectified=self._is_rectified, size_px=size_px, is_whole=is_whole
            )
        except calib.CameraError as error:
            self.error = str(error)
            return None
        self.error = None
        if any(_values(message)["d"]) and (self._is_rectified or camera.distortion):
            self.choice = LensChoice(self._is_rectified, camera)
        return camera

    def camera(self, width: int, height: int) -> calib.PinholeCamera | None:
        """The camera for images of this size, scaled if needed; None if none fits."""
        if (width, height) in self._cameras:
            return self._cameras[width, height]
        if self._without_size is not None:
            camera = self._build(self._without_size, (width, height))
            if camera is not None:
                self._cameras[width, height] = camera
            return camera
        whole = self._of_region
        if whole is not None and (whole.width, whole.height) == (width, height):
            tell_choice(f"the pictures are whole, {width}x{height} px: its roi is not used")
            camera = self._build(whole, is_whole=True)
            if camera is not None:
                self._cameras[width, height] = camera
            return camera
        for camera in reversed(self._cameras.values()):
            with suppress(calib.CameraError):
                return camera.scaled(width, height)
        return None
