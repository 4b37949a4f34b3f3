"""Cameras from sensor_msgs/CameraInfo messages."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Final

import calib
from calib.files import ros

_MATRIX: Final = 9


def camera_of_message(message: Any, *, is_rectified: bool = False) -> calib.PinholeCamera:
    """The camera that a CameraInfo message describes.

    Args:
        message: a CameraInfo message of ROS 1 or ROS 2.
        is_rectified: Whether the images are rectified. Their camera is in the matrix P, without
            distortion.

    Raises:
        CameraError: The message is of an uncalibrated camera or of a lens that is not supported.
    """
    values = _values(message)
    if is_rectified and any(values["p"]):
        fx, _, cx, _, _, fy, cy, *_ = values["p"]
        values |= {"k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], "d": [], "distortion_model": ""}
    return ros.build_message(values)


def _values(message: Any) -> dict[str, Any]:
    """The fields that make the camera; ROS 1 writes the matrices in capitals."""
    matrices = {
        name: [float(value) for value in getattr(message, name, getattr(message, name.upper(), ()))]
        for name in ("k", "d", "p")
    }
    roi = message.roi
    return {
        "width": int(message.width),
        "height": int(message.height),
        "distortion_model": str(message.distortion_model),
        "roi": {"width": int(roi.width), "height": int(roi.height)},
        **matrices,
    }


class CameraInfos:
    """The cameras of one topic, which change if the camera changes its resolution.

    Args:
        is_rectified: Whether the images are rectified.
    """

    def __init__(self, *, is_rectified: bool = False) -> None:
        self._is_rectified = is_rectified
        self._key: str | None = None
        self._cameras: dict[tuple[int, int], calib.PinholeCamera] = {}
        self.error: str | None = None

    def add(self, message: Any) -> None:
        """Take a message. A camera that cannot be used leaves its reason in `error`."""
        key = repr(_values(message))
        if key == self._key:
            return
        self._key = key
        try:
            camera = camera_of_message(message, is_rectified=self._is_rectified)
        except calib.CameraError as error:
            self.error = str(error)
            return
        self._cameras.pop((camera.width, camera.height), None)
        self._cameras[camera.width, camera.height] = camera  # the newest is the last

    def camera(self, width: int, height: int) -> calib.PinholeCamera | None:
        """The camera for images of this size, scaled if needed; None if none fits."""
        if (width, height) in self._cameras:
            return self._cameras[width, height]
        for camera in reversed(self._cameras.values()):
            with suppress(calib.CameraError):
                return camera.scaled(width, height)
        return None
