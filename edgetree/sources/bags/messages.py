"""Arrays from ROS messages: Image, CompressedImage and compressedDepth."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from basetree.files.limits import current_limits
from basetree.files.reading import decode_image

IMAGE_TYPES: Final = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")

_PNG: Final = b"\x89PNG\r\n\x1a\n"
_DEPTH_HEADER: Final = struct.Struct("<iff")  # format, and two parameters of the inverse depth
# Encodings of sensor_msgs/image_encodings: type, channels, and OpenCV's conversion to BGR.
# OpenCV names a Bayer pattern by the second and third pixel of its second row.
_COLOUR: Final[dict[str, tuple[int, int | None]]] = {
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "8UC4": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUYV),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUYV),
    "bayer_rggb8": (1, cv2.COLOR_BAYER_BG2BGR),
    "bayer_bggr8": (1, cv2.COLOR_BAYER_RG2BGR),
    "bayer_gbrg8": (1, cv2.COLOR_BAYER_GR2BGR),
    "bayer_grbg8": (1, cv2.COLOR_BAYER_GB2BGR),
    "mono8": (1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, cv2.COLOR_GRAY2BGR),
}
_GREY: Final = ("mono8", "8UC1")
_DEPTH: Final = {"16UC1": np.uint16, "mono16": np.uint16, "32FC1": np.float32}


@dataclass(frozen=True)
class PictureKind:
    """What an image topic carries.

    Attributes:
        role: "colour", "grey", "depth" or "other".
        encoding: The encoding or format, for messages.
    """

    role: str
    encoding: str


def stamp_ns(message: Any) -> int:
    """The time stamp of a message's header, ns; 0 if its driver does not set it."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def kind_of_picture(message: Any, topic: str) -> PictureKind:
    """Tell colour from depth by the encoding, and by the topic's name where that is not enough.

    Args:
        message: The first Image or CompressedImage of a topic.
        topic: The topic's name.
    """
    is_named_depth = "depth" in topic.lower()
    if not hasattr(message, "encoding"):
        form = str(message.format)
        is_16_bits = form.startswith(tuple(_DEPTH))
        is_depth = "compressedDepth" in form or topic.endswith("/compressedDepth") or is_16_bits
        return PictureKind("depth" if is_depth else "colour", form)
    encoding = str(message.encoding)
    if encoding in _DEPTH:
        is_depth = is_named_depth or encoding == "16UC1"
        return PictureKind("depth" if is_depth else "other", encoding)
    if encoding not in _COLOUR:
        return PictureKind("other", encoding)
    return PictureKind("grey" if encoding in _GREY else "colour", encoding)


def decode_picture(message: Any, topic: str) -> NDArray[Any]:
    """Decode an Image or CompressedImage.

    Args:
        message: The message.
        topic: Its topic, for messages.

    Returns:
        (H, W, 3) uint8 BGR for colour, or (H, W) uint16 or float32 for depth, in its own unit.

    Raises:
        InputError: The message cannot be decoded.
    """
    try:
        picture = _decode_raw(message) if hasattr(message, "encoding") else _decode_packed(message)
    except (ValueError, InputError, cv2.error, struct.error) as error:
        raise InputError(f"an image of topic {topic} cannot be decoded: {error}") from error
    if picture is None:
        raise InputError(
            f"an image of topic {topic} cannot be decoded ({len(message.data)} bytes,"
            f" {message.format!r}): expected a complete JPEG or PNG"
        )
    return picture


def _decode_raw(message: Any) -> NDArray[Any]:
    encoding = str(message.encoding)
    width, height, step = int(message.width), int(message.height), int(message.step)
    _check_pixels(width, height)
    if encoding in _DEPTH:
        dtype = np.dtype(_DEPTH[encoding]).newbyteorder(">" if message.is_bigendian else "<")
        rows = _rows(message.data, width * dtype.itemsize, height, step)
        return np.ascontiguousarray(rows).view(dtype).astype(dtype.newbyteorder("="), copy=False)
    if encoding not in _COLOUR:
        raise ValueError(f"its encoding is {encoding!r}, expected {', '.join((*_COLOUR, *_DEPTH))}")
    channels, code = _COLOUR[encoding]
    rows = _rows(message.data, width * channels, height, step)
    pixels = np.array(rows).reshape(height, width, channels)
    return pixels if code is None else np.asarray(cv2.cvtColor(pixels, code), np.uint8)


def _rows(data: NDArray[np.uint8], width_bytes: int, height: int, step: int) -> NDArray[np.uint8]:
    """(height, width_bytes) the rows without their padding."""
    step = step or width_bytes
    if step < width_bytes or len(data) < step * (height - 1) + width_bytes:
        raise ValueError(
            f"it has {len(data)} bytes in rows of {step}, expected {height} rows of {width_bytes}"
        )
    if len(data) < step * height:  # some drivers leave out the padding of the last row
        data = np.pad(data, (0, step * height - len(data)))
    return data[: step * height].reshape(height, step)[:, :width_bytes]


def _decode_packed(message: Any) -> NDArray[Any] | None:
    form = str(message.format)
    data = message.data.tobytes()
    if "compressedDepth" in form:
        return _decode_depth(data, form)
    is_depth = form.startswith(tuple(_DEPTH))
    return decode_image(data, cv2.IMREAD_UNCHANGED if is_depth else cv2.IMREAD_COLOR)


def _decode_depth(data: bytes, form: str) -> NDArray[Any] | None:
    """Decode compressedDepth: a header and a 16-bit PNG, for 32FC1 of quantised inverse depth."""
    if "rvl" in form.lower():
        raise ValueError(f"its format is {form!r}, expected compressedDepth with PNG")
    start = data.find(_PNG, 0, 64)
    png = data[max(start, 0) :]
    values = decode_image(png, cv2.IMREAD_UNCHANGED)
    if values is None or values.ndim != 2 or values.dtype != np.uint16:
        return None
    if not form.startswith("32FC1"):
        return values
    if start < _DEPTH_HEADER.size:
        raise ValueError("the header of its 32FC1 depth is missing, expected 12 bytes")
    _, scale, offset = _DEPTH_HEADER.unpack_from(data)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = np.float32(scale) / (values.astype(np.float32) - np.float32(offset))
    return np.where(values > 0, depth_m, np.float32(0))


def _check_pixels(width: int, height: int) -> None:
    largest = current_limits().image_pixels
    if not 0 < width * height <= largest:
        raise ValueError(
            f"it is {width}x{height} px, expected 1 to {largest} pixels, the limit image_pixels"
        )
