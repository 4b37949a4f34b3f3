"""Arrays from ROS messages: Image, CompressedImage, compressedDepth and packets of video."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from basetree.files.reading import decode_image
from edgetree.sources.bags.encodings import (
    COLOUR_NAMES,
    DEPTH_NAMES,
    GREY_NAMES,
    ColourPixels,
    colour_names,
    decode_depth_pixels,
    depth_names,
    plain_name,
)
from edgetree.sources.bags.rvl import decode_rvl
from edgetree.sources.bags.topic_words import depth_by_name
from edgetree.sources.bags.video_packets import (
    FFMPEG_TYPE,
    FOXGLOVE_TYPE,
    VideoDecoder,
    codec_of,
)

IMAGE_TYPES: Final = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    FFMPEG_TYPE,
    FOXGLOVE_TYPE,
)
TRANSPORTS: Final = ("/compressed", "/compressedDepth", "/ffmpeg", "/foxglove")

_PNG: Final = b"\x89PNG\r\n\x1a\n"
_PNG_OF_16_BITS: Final = bytes((16, 0))  # bits and kind of colour, grey, at this place
_PNG_KIND: Final = slice(24, 26)
_DEPTH_HEADER: Final = struct.Struct("<iff")  # format, and two parameters of the inverse depth
_RTABMAP: Final = b"DRVL"
_UNSURE: Final = ("mono16", "y16", "gray16")  # a picture, unless a name tells depth


@dataclass(frozen=True)
class PictureKind:
    """What an image topic carries.

    Attributes:
        role: "colour", "grey", "depth" or "other".
        encoding: The encoding or format, for messages.
        reason: Why it is "other", for messages.
    """

    role: str
    encoding: str
    reason: str = ""


def stamp_ns(message: Any) -> int:
    """The time stamp of a message, ns; 0 if its driver does not set it."""
    stamp = message.header.stamp if hasattr(message, "header") else message.timestamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def frame_name(name: str) -> str:
    """The name of a frame without the slash that ROS 1 put before it."""
    return str(name).lstrip("/")


def frame_of(message: Any) -> str:
    """The frame of a message, as `frame_name` gives it."""
    return frame_name(message.header.frame_id if hasattr(message, "header") else message.frame_id)


def kind_of_picture(message: Any, topic: str, frames: Sequence[str] = ()) -> PictureKind:
    """Tell colour from depth by the encoding, and by names where that is not enough.

    Args:
        message: The first message of a topic of `IMAGE_TYPES`.
        topic: The topic's name.
        frames: Frames of the pictures and of their camera.
    """
    encoding = _encoding(message)
    if _codec(message) is not None:
        return PictureKind("colour", encoding)
    if _is_packet(message):
        return PictureKind("other", encoding, "its code is not read, expected h264 or h265")
    name = _single_channel(message)
    told, word = depth_by_name((without_transport(topic), *frames))
    if name in DEPTH_NAMES:
        ask = f": expected --topic depth={topic} if it is"
        if told == "depth" or name == "z16" or (not told and _is_compressed_depth(message)):
            return PictureKind("depth", encoding)
        if told == "other":
            return PictureKind("other", encoding, f"{word!r} in its name is no depth{ask}")
        if name in _UNSURE:
            return PictureKind("grey", encoding)
        reason = f"nothing in its name or frame tells whether it is depth{ask}"
        return PictureKind("other", encoding, reason)
    if not hasattr(message, "encoding"):
        return PictureKind("colour", encoding)
    name = plain_name(encoding)
    if name in COLOUR_NAMES:
        return PictureKind("colour", encoding)
    if name in GREY_NAMES:
        return PictureKind("grey", encoding)
    names = depth_names() if told == "depth" else colour_names()
    return PictureKind("other", encoding, f"its encoding is not read, expected {names}")


def _encoding(message: Any) -> str:
    return str(message.encoding if hasattr(message, "encoding") else message.format)


def _is_packet(message: Any) -> bool:
    """Whether a message is of a type for video alone."""
    return hasattr(message, "timestamp") or hasattr(message, "pts")


def _codec(message: Any) -> str | None:
    """The code of a packet of video; None for pictures of their own."""
    return None if hasattr(message, "step") else codec_of(_encoding(message))


def _is_compressed_depth(message: Any) -> bool:
    return not hasattr(message, "encoding") and "compresseddepth" in str(message.format).lower()


def _single_channel(message: Any) -> str:
    """The encoding of a picture of one channel and more than 8 bits; "" of other pictures."""
    encoding = _encoding(message)
    if hasattr(message, "encoding"):
        return plain_name(encoding) if plain_name(encoding) in DEPTH_NAMES else ""
    name = plain_name(encoding.partition(";")[0])
    if name in DEPTH_NAMES:
        return name
    data = message.data
    is_deep_png = data[:8].tobytes() == _PNG and data[_PNG_KIND].tobytes() == _PNG_OF_16_BITS
    is_code = "rvl" in encoding.lower()
    return "16uc1" if _is_compressed_depth(message) or is_deep_png or is_code else ""


def without_transport(topic: str) -> str:
    """The name of a topic without that of its transport."""
    for transport in TRANSPORTS:
        topic = topic.removesuffix(transport)
    return topic


class PictureDecoder:
    """Decodes the pictures of one topic.

    Args:
        topic: The topic's name, for messages.
        role: What it is read as.

    """

    def __init__(self, topic: str, role: Literal["colour", "depth"]) -> None:
        self._topic, self._role = topic, role
        self._pixels = ColourPixels()
        self._video: VideoDecoder | None = None

    @property
    def is_before_key_frame(self) -> bool:
        """Whether packets of video have come, and no key frame yet."""
        return self._video is not None and not self._video.has_started

    @property
    def remark(self) -> str:
        """What was assumed; empty if nothing."""
        bits = self._pixels.bits
        return f"topic {self._topic}: values of 16 bits are read as of {bits} bits" if bits else ""

    def arrived(self, message: Any) -> None:
        """Take note of a picture in the order of recording, before it is decoded or left out.

        Raises:
            MissingPackage: It is a packet of video, and PyAV is not installed.
        """
        codec = _codec(message)
        if codec is not None:
            self._video = self._video or VideoDecoder(codec)
            self._video.add(message)

    def decode(self, message: Any) -> NDArray[Any]:
        """Decode a picture that has arrived.

        Returns:
            (H, W, 3) uint8 BGR for colour, or (H, W) depth of uint16 or floating point, in its own
            unit.

        Raises:
            InputError: The message cannot be decoded.
        """
        try:
            if self._video is not None and _codec(message) is not None:
                picture: NDArray[Any] | None = self._video.decode(message)
            elif not hasattr(message, "encoding"):
                picture = _decode_packed(message, is_depth=self._role == "depth")
            elif self._role == "depth":
                picture = decode_depth_pixels(message)
            else:
                picture = self._pixels.decode(message)
        except (ValueError, InputError, cv2.error, struct.error) as error:
            raise InputError(
                f"an image of topic {self._topic} cannot be decoded: {error}"
            ) from error
        if picture is None:
            raise InputError(
                f"an image of topic {self._topic} cannot be decoded ({len(message.data)} bytes,"
                f" {_encoding(message)!r}): expected a complete JPEG, PNG, TIFF, BMP or WebP, RVL"
                " of depth, or H.264 or H.265"
            )
        if (picture.ndim == 3) != (self._role == "colour"):
            found = "colour" if picture.ndim == 3 else "depth"
            raise InputError(f"an image of topic {self._topic} is {found}: expected {self._role}")
        return picture


def _decode_packed(message: Any, *, is_depth: bool) -> NDArray[Any] | None:
    form, data = str(message.format), message.data.tobytes()
    if "rvl" in form.lower() or data.startswith(_RTABMAP):
        return _inverse_if_float(decode_rvl(_after_header(data, form)), data, form)
    if _is_compressed_depth(message):
        start = max(data.find(_PNG, 0, 64), 0)
        values = decode_image(data[start:], cv2.IMREAD_UNCHANGED)
        if values is None or values.ndim != 2 or values.dtype != np.uint16:
            return None
        return _inverse_if_float(values, data[:start], form)
    values = decode_image(data, cv2.IMREAD_UNCHANGED if is_depth else cv2.IMREAD_COLOR)
    if is_depth and values is not None and values.ndim == 2 and values.dtype == np.uint8:
        raise ValueError("it has 8 bits, expected depth of 16 bits or floating point")
    return values


def _after_header(data: bytes, form: str) -> bytes:
    """The RVL code with its size before it, without the header of its transport."""
    if data.startswith(_RTABMAP):
        return data[len(_RTABMAP) :]
    has_header = "compresseddepth" in form.lower() or data[:4] == bytes(4)
    return data[_DEPTH_HEADER.size :] if has_header else data


def _inverse_if_float(values: NDArray[np.uint16], header: bytes, form: str) -> NDArray[Any]:
    """Depth of quantised inverse depth if it was 32FC1, by the parameters in the header."""
    if not form.lower().startswith("32fc1"):
        return values
    if len(header) < _DEPTH_HEADER.size:
        raise ValueError("the header of its 32FC1 depth is missing, expected 12 bytes")
    _, scale, offset = _DEPTH_HEADER.unpack_from(header)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth_m = np.float32(scale) / (values.astype(np.float32) - np.float32(offset))
    return np.where(values > 0, depth_m, np.float32(0))
