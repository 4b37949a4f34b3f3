"""Frames as programs hand them over: their pixels, and what becomes of them in metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from basetree.files.limits import current_limits
from calib import PinholeCamera, RigidTransform
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.serve.messages import Colour, Depth, FrameMessage, Pose
from edgetree.sources.arrays import frame_from_arrays

LARGEST_PART_BYTES: Final = 64 * 2**20
"""Bytes of the largest part of a message, and of the largest image in shared memory."""

_ROUNDING: Final = 1e-12


@dataclass(frozen=True, eq=False)
class HandedFrame:
    """A frame as a program handed it over.

    Attributes:
        number: Number that the service gave it.
        message: What the program said.
        colour: The pixels of the colour image.
        depth: The numbers of the depth image.
    """

    number: int
    message: FrameMessage
    colour: NDArray[Any] | None
    depth: NDArray[Any] | None

    def frame(self, rig: Rig) -> Frame:
        """The frame in metres.

        Args:
            rig: Its camera takes the place of the frame's own; it corrects the depth.

        Raises:
            InputError: A value cannot be used.
        """
        message = self.message
        pose, depth = message.pose, message.depth
        frame = frame_from_arrays(
            self.number,
            message.time_s,
            self.colour,
            self.depth,
            depth_scale_m=None if depth is None else depth.scale_m,
            depth_kind="depth" if depth is None else depth.kind,
            colour_order="rgb" if message.colour and "rgb" in message.colour.format else "bgr",
            camera=self._camera(rig),
            up_camera=message.up_camera,
            pose=None if pose is None else _transform(pose),
        )
        if message.up_camera is not None and _is_unit(message.up_camera):
            # As it is, so that the metres are those of the same frame from elsewhere.
            frame = replace(frame, up_camera=np.array(message.up_camera))
        if rig.depth_calibration is None or frame.depth_m is None:
            return frame
        return replace(frame, depth_m=rig.depth_calibration.apply(frame.depth_m))

    def _camera(self, rig: Rig) -> PinholeCamera | None:
        image = self.message.colour or self.message.depth
        if image is not None and (camera := rig.camera_for(image.width, image.height)) is not None:
            return camera
        own = self.message.camera
        return None if own is None else PinholeCamera(**msgspec.structs.asdict(own))


def _is_unit(direction: tuple[float, float, float]) -> bool:
    return abs(math.hypot(*direction) - 1) < _ROUNDING


def _transform(pose: Pose) -> RigidTransform:
    return RigidTransform(np.array(pose.rotation), np.array(pose.translation_m))


def inline_pixels(
    message: FrameMessage, parts: Sequence[bytes | memoryview]
) -> list[NDArray[Any] | None]:
    """The arrays of the colour and depth image that came as parts; None for the others.

    Args:
        message: The frame.
        parts: The parts after the first. The arrays are views of them.

    Raises:
        InputError: An image is too large, or a part is missing, too many, or of another size.
    """
    images = [message.colour, message.depth]
    for image in images:
        _check_size(image)
    inline = [image for image in images if image is not None and image.memory is None]
    if len(parts) != len(inline):
        raise InputError(
            f"the message has {len(parts)} parts of pixels: expected {len(inline)}, one for each"
            " image without memory"
        )
    left = iter(parts)
    return [
        None if image is None or image.memory is not None else _array(image, next(left))
        for image in images
    ]


def size_bytes(image: Colour | Depth) -> int:
    """The bytes of an image's pixels."""
    shape, kind = image.array_type
    return int(np.prod(shape, dtype=np.int64)) * kind.itemsize


def _check_size(image: Colour | Depth | None) -> None:
    if image is None:
        return
    if (bytes_ := size_bytes(image)) > LARGEST_PART_BYTES:
        raise InputError(
            f"an image of {image.width}x{image.height} px has {bytes_} bytes: expected at most"
            f" {LARGEST_PART_BYTES}"
        )
    if (pixels := image.width * image.height) > (most := current_limits().image_pixels):
        raise InputError(f"an image has {pixels} pixels: expected at most {most}")


def _array(image: Colour | Depth, part: bytes | memoryview) -> NDArray[Any]:
    expected = size_bytes(image)
    if len(part) != expected:
        raise InputError(
            f"an image of {image.width}x{image.height} px in {image.format} has {len(part)} bytes:"
            f" expected {expected}"
        )
    shape, kind = image.array_type
    return np.frombuffer(part, kind).reshape(shape)
