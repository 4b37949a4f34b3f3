"""Camera, vertical, noise and rotation of each frame, in recordings that edgetree made.

Standard messages do not carry all of it: an IMU is smoothed when it is read, and CameraInfo has no
error of the focal length. The measurement would differ in the last digits, or in a choice that
depends on them. Depth of a scanner's beams has a second image, without the gaps between them.
"""

from __future__ import annotations

import json
import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import CameraError, PinholeCamera
from edgetree.frames.frame import DepthNoise, Frame
from edgetree.frames.turning import check_rotation

EXACT_TOPIC: Final = "/edgetree/frame"
EXACT_TYPE: Final = "std_msgs/msg/String"
FILLED_TOPIC: Final = "/edgetree/filled_depth"
FILLED_TYPE: Final = "sensor_msgs/msg/Image"
_SCHEMA: Final = "edgetree.recording.frame/1"
_MAX_WAITING: Final = 100
_MAX_FILLED: Final = 20  # images, which take memory
_UNIT_TOLERANCE: Final = 1e-6


def exact_record(
    stamp_ns: int,
    camera: PinholeCamera | None,
    up_camera: NDArray[np.float64] | None,
    depth_noise: DepthNoise | None = None,
    rotation_deg: int | None = None,
    images: Sequence[str] = (),
) -> dict[str, Any]:
    """What standard messages do not carry of a frame, as a JSON object.

    Args:
        stamp_ns: Time stamp of the frame in the recording, ns.
        camera: Its intrinsics; None if they are not known.
        up_camera: (3,) unit vector away from gravity in the camera's frame; None if unknown.
        depth_noise: What the source knows of the errors of the depth; None if it does not.
        rotation_deg: Degrees by which the picture must be turned clockwise; None if not given.
        images: Its images, of "colour" and "depth".
    """
    return {
        "schema": _SCHEMA,
        "stamp_ns": stamp_ns,
        "camera": None if camera is None else camera.to_dict(),
        "up_camera": None if up_camera is None else up_camera.tolist(),
        "depth_noise": None if depth_noise is None else asdict(depth_noise),
        "rotation_deg": rotation_deg,
        "images": list(images),
    }


class _Exact(NamedTuple):
    camera: PinholeCamera | None
    up_camera: NDArray[np.float64] | None
    depth_noise: DepthNoise | None
    rotation_deg: int | None
    images: tuple[str, ...]


class ExactValues:
    """The values of frames that are still to come, by their time stamps."""

    def __init__(self) -> None:
        self._waiting: OrderedDict[int, _Exact] = OrderedDict()
        self._filled: OrderedDict[int, NDArray[np.float32]] = OrderedDict()

    def add(self, text: str) -> None:
        """Take a message.

        Raises:
            InputError: It is none of these messages.
        """
        try:
            values = json.loads(text)
            if values["schema"] != _SCHEMA:
                raise ValueError(f"its schema is {values['schema']!r}")
            camera = None if values["camera"] is None else _camera(values["camera"])
            up_camera = None if values["up_camera"] is None else _unit(values["up_camera"])
            noise = _noise(values.get("depth_noise"))
            rotation_deg = values.get("rotation_deg")
            check_rotation(rotation_deg, "its rotation_deg")
            images = tuple(values.get("images", ()))
            if not set(images) <= {"colour", "depth"}:
                raise ValueError(f"its images are {images}, expected colour and depth")
            stamp = values["stamp_ns"]
            if not isinstance(stamp, int):
                raise ValueError(f"its stamp_ns is {stamp!r}, expected a whole number")
        except (
            ValueError,
            TypeError,
            KeyError,
            RecursionError,
            OverflowError,
            CameraError,
            InputError,
        ) as error:
            raise InputError(
                f"a message of {EXACT_TOPIC} cannot be used ({error}): expected {_SCHEMA}"
            ) from error
        self._waiting[stamp] = _Exact(camera, up_camera, noise, rotation_deg, images)
        if len(self._waiting) > _MAX_WAITING:
            self._waiting.popitem(last=False)

    def add_filled(self, stamp_ns: int, depth_m: NDArray[Any]) -> None:
        """Take the depth of a frame's beams without the gaps between them, (H, W) metres."""
        self._filled[stamp_ns] = depth_m.astype(np.float32, copy=False)
        if len(self._filled) > _MAX_FILLED:
            self._filled.popitem(last=False)

    def is_alone(self, stamp_ns: int) -> bool:
        """Whether the frame of a time stamp is known to have one image alone."""
        exact = self._waiting.get(stamp_ns)
        return exact is not None and len(exact.images) == 1

    def applied(self, frame: Frame, stamp_ns: int) -> Frame:
        """A frame with its exact values, if they have come.

        Args:
            frame: The frame.
            stamp_ns: Its time stamp in the recording, ns.
        """
        exact, filled_m = self._waiting.pop(stamp_ns, None), self._filled.pop(stamp_ns, None)
        shape = None if frame.depth_m is None else frame.depth_m.shape
        if filled_m is not None and filled_m.shape == shape:
            frame = replace(frame, filled_depth_m=filled_m)
        pixels = frame.depth_m if frame.image is None else frame.image
        if exact is None or pixels is None:
            return frame
        camera = exact.camera
        if camera is not None and (camera.height, camera.width) != pixels.shape[:2]:
            return frame
        return replace(
            frame,
            camera=camera,
            up_camera=exact.up_camera,
            depth_noise=exact.depth_noise or frame.depth_noise,
            rotation_deg=exact.rotation_deg,
        )


def _camera(values: Any) -> PinholeCamera:
    if not isinstance(values, dict):
        raise ValueError(f"its camera is {type(values).__name__}, expected an object")
    return PinholeCamera.from_dict(values)


def _noise(values: Any) -> DepthNoise | None:
    """The errors of a depth; None if they are not known, as of recordings of earlier versions."""
    if values is None:
        return None
    noise = DepthNoise(**values)
    for name, value in asdict(noise).items():
        if value is not None and not (isinstance(value, int | float) and 0 <= value < math.inf):
            raise ValueError(f"its {name} is {value!r}, expected at least 0")
    return noise


def _unit(values: Any) -> NDArray[np.float64]:
    up = np.array(values, np.float64)
    if up.shape != (3,) or not abs(np.linalg.norm(up) - 1) < _UNIT_TOLERANCE:
        raise ValueError(f"up_camera is {values}, expected a unit vector")
    return up
