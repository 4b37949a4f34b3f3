"""The messages of the service, and their JSON Schema.

A message is one ZeroMQ message of one to three parts: a JSON text, and then the pixels of each
image that is not in shared memory, colour first.
"""

from __future__ import annotations

import inspect
import json
from typing import Annotated, Any, Final, Literal, TypeAlias, cast

import msgspec
import numpy as np
from msgspec import Meta

from basetree.errors import InputError
from basetree.files.json import decode

_LARGEST_TEXT_BYTES: Final = 64 * 2**10
_CHANNELS: Final = {"bgr8": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4, "mono8": 1}
_DEPTH_TYPES: Final[dict[str, np.dtype[Any]]] = {
    "uint16": np.dtype("<u2"),
    "float32": np.dtype("<f4"),
}

_Side: TypeAlias = Annotated[int, Meta(ge=1, le=65_535)]
_Triple: TypeAlias = tuple[float, float, float]
_Number: TypeAlias = Annotated[int, Meta(ge=0, le=2**53)]


class Memory(msgspec.Struct, frozen=True):
    """Where the pixels of an image are in POSIX shared memory, on Linux.

    The memory must not change until the answer to the frame is there. The service removes its name
    when it reads it for the first time and keeps it open, so that nothing is left behind when a
    program dies.

    Attributes:
        name: Name as for `shm_open`, which begins with /edgetree-.
        offset: Byte at which the pixels begin.
    """

    name: Annotated[str, Meta(pattern=r"^/edgetree-[A-Za-z0-9_.-]{1,100}$")]
    offset: Annotated[int, Meta(ge=0, le=2**40)] = 0


class Colour(msgspec.Struct, frozen=True):
    """A colour image: pixels row by row, without gaps.

    Attributes:
        width: Width in px.
        height: Height in px.
        format: Order of the channels, of one byte each.
        memory: Where the pixels are; None if they are the next part of the message.
    """

    width: _Side
    height: _Side
    format: Literal["bgr8", "rgb8", "bgra8", "rgba8", "mono8"] = "bgr8"
    memory: Memory | None = None

    @property
    def array_type(self) -> tuple[tuple[int, ...], np.dtype[Any]]:
        """Shape and type of the pixels."""
        channels = _CHANNELS[self.format]
        shape = (self.height, self.width) if channels == 1 else (self.height, self.width, channels)
        return shape, np.dtype(np.uint8)


class Depth(msgspec.Struct, frozen=True):
    """A depth image, aligned with the colour image: little-endian, row by row, without gaps.

    0, NaN and infinity are no reading.

    Attributes:
        width: Width in px.
        height: Height in px.
        format: Type of the numbers.
        scale_m: Metres per unit; if None, 0.001 for uint16 and 1 for float32.
        kind: Depth along the optical axis, or range along the ray of each pixel.
        memory: Where the pixels are; None if they are the next part of the message.
    """

    width: _Side
    height: _Side
    format: Literal["uint16", "float32"] = "uint16"
    scale_m: float | None = None
    kind: Literal["depth", "range"] = "depth"
    memory: Memory | None = None

    @property
    def array_type(self) -> tuple[tuple[int, ...], np.dtype[Any]]:
        """Shape and type of the pixels."""
        return (self.height, self.width), _DEPTH_TYPES[self.format]


class Camera(msgspec.Struct, frozen=True, omit_defaults=True):
    """Intrinsics of the image, as `calib.PinholeCamera` has them: pixel centres are whole numbers.

    Attributes:
        width: Width of the image that they are for, px.
        height: Its height, px.
        fx: Focal length along x, px.
        fy: Focal length along y, px.
        cx: Principal point's x, px.
        cy: Principal point's y, px.
        distortion: Coefficients in OpenCV's order.
        distortion_model: "radtan" or "fisheye".
        focal_std_px: Standard deviation of fx and fy, px; 0 if unknown.
        principal_std_px: Standard deviation of cx and cy, px; None if it is not stated.
    """

    width: _Side
    height: _Side
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Annotated[tuple[float, ...], Meta(max_length=14)] = ()
    distortion_model: Literal["radtan", "fisheye"] = "radtan"
    focal_std_px: float = 0.0
    principal_std_px: float | None = None


class Pose(msgspec.Struct, frozen=True):
    """Transform from the camera's frame (x right, y down, z forward) to a fixed one with z up.

    Attributes:
        rotation: Rotation matrix, row by row.
        translation_m: Place of the camera, m.
    """

    rotation: tuple[_Triple, _Triple, _Triple]
    translation_m: _Triple


class FrameMessage(
    msgspec.Struct,
    frozen=True,
    omit_defaults=True,
    tag_field="schema",
    tag="edgetree.serve.frame/1",
):
    """To the service: one frame. It gets one answer: a result, "unused" or an error.

    Attributes:
        id: Number that the answer repeats.
        time_s: Time stamp of the picture in any clock, s.
        colour: The colour image; None if there is only depth.
        depth: The depth image; None if there is only colour.
        camera: Intrinsics; None if they are not known. A camera given to the service goes first.
        up_camera: Direction away from gravity in the camera's frame, of any length, as an
            accelerometer at rest reads it; None if it is not known.
        pose: Where the camera is; None if it is not known.
    """

    id: _Number
    time_s: float
    colour: Colour | None = None
    depth: Depth | None = None
    camera: Camera | None = None
    up_camera: _Triple | None = None
    pose: Pose | None = None


class WatchMessage(msgspec.Struct, frozen=True, tag_field="schema", tag="edgetree.serve.watch/1"):
    """To the service: send me each result from now on, of whatever source."""


class AskMessage(msgspec.Struct, frozen=True, tag_field="schema", tag="edgetree.serve.ask/1"):
    """To the service: how are you? The answer is a status."""


class ByeMessage(msgspec.Struct, frozen=True, tag_field="schema", tag="edgetree.serve.bye/1"):
    """To the service: I hand over no more frames, and watch no more. There is no answer."""


class ResultAnswer(msgspec.Struct, frozen=True, tag_field="schema", tag="edgetree.serve.result/1"):
    """From the service: the result of a frame.

    Attributes:
        id: Number of the frame; None in what watchers get.
        result: A record of the schema edgetree.live/1, as `edgetree live` writes it.
    """

    id: int | None
    result: dict[str, Any]


class UnusedAnswer(msgspec.Struct, frozen=True, tag_field="schema", tag="edgetree.serve.unused/1"):
    """From the service: a frame was left out.

    Attributes:
        id: Number of the frame.
        reason: Why, such as that a newer one had arrived.
    """

    id: int
    reason: str


class ErrorAnswer(msgspec.Struct, frozen=True, tag_field="schema", tag="edgetree.serve.error/1"):
    """From the service: a message cannot be used.

    Attributes:
        id: Number of the frame; None if it is not known.
        error: What was found and what was expected.
    """

    id: int | None
    error: str


class StatusAnswer(msgspec.Struct, frozen=True, tag_field="schema", tag="edgetree.serve.status/1"):
    """From the service: how it goes.

    The program that hands frames over gets one unasked where another one would like to.

    Attributes:
        version: Version of edgetree.
        state: "starting" before the first result, "running", "lost" while no frames come, "ended".
        results: Frames that have a result.
        silent_s: Time since the last result, s.
        line: The whole state in words.
        faults: Messages that could not be used, by kind.
    """

    version: str
    state: str
    results: int
    silent_s: float
    line: str
    faults: dict[str, int]


Message: TypeAlias = FrameMessage | WatchMessage | AskMessage | ByeMessage
Answer: TypeAlias = ResultAnswer | UnusedAnswer | ErrorAnswer | StatusAnswer


class _Numbered(msgspec.Struct):
    id: _Number


def id_in(text: bytes | memoryview) -> int | None:
    """The id in a message that cannot be used otherwise; None if there is none."""
    try:
        return decode(_Numbered, bytes(text[:_LARGEST_TEXT_BYTES]), "the message").id
    except InputError:
        return None


def read_message(text: bytes | memoryview) -> Message:
    """Read the first part of a message to the service.

    Raises:
        InputError: It is too long, no JSON, or a field is missing or wrong.
    """
    if len(text) > _LARGEST_TEXT_BYTES:
        raise InputError(
            f"the message's first part has {len(text)} bytes: expected a JSON text of at most"
            f" {_LARGEST_TEXT_BYTES} bytes, and the pixels in parts of their own"
        )
    return decode(cast("type[Message]", Message), bytes(text), "the message")


def schema_text() -> str:
    """The JSON Schema of all messages, as it stands in `messages.schema.json`."""
    kinds = [*Message.__args__, *Answer.__args__]
    references, components = msgspec.json.schema_components(kinds, ref_template="#/$defs/{name}")
    for component in components.values():
        component["description"] = inspect.cleandoc(component["description"])
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Messages of the service of edgetree",
        "description": "The first part of each ZeroMQ message, to the service and from it.",
        "oneOf": list(references),
        "$defs": components,
    }
    return json.dumps(schema, indent=1) + "\n"
