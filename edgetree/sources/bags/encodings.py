"""Arrays from the pixels of Image messages, by the names of their encodings."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.files.limits import current_limits


class _Pixels(NamedTuple):
    """Bits of a value, values of a pixel, and OpenCV's conversion to BGR."""

    bits: int
    channels: int
    code: int | None


_BITS: Final = (8, 16)
# OpenCV names a Bayer pattern by the second and third pixel of its second row.
_BAYER: Final = {
    "rggb": cv2.COLOR_BAYER_BG2BGR,
    "bggr": cv2.COLOR_BAYER_RG2BGR,
    "gbrg": cv2.COLOR_BAYER_GR2BGR,
    "grbg": cv2.COLOR_BAYER_GB2BGR,
}
_PACKED_YUV: Final = {
    cv2.COLOR_YUV2BGR_UYVY: ("uyvy", "yuv422", "uyvy422", "yuv422_uyvy"),
    cv2.COLOR_YUV2BGR_YUYV: ("yuyv", "yuy2", "yuyv422", "yuv422_yuy2", "yuv422_yuyv"),
    cv2.COLOR_YUV2BGR_YVYU: ("yvyu", "yvyu422", "yuv422_yvyu"),
}
# Names of sensor_msgs/image_encodings and of drivers, in lower case.
_COLOUR: Final[dict[str, _Pixels]] = {
    **{f"bgr{bits}": _Pixels(bits, 3, None) for bits in _BITS},
    **{f"{bits}uc3": _Pixels(bits, 3, None) for bits in _BITS},
    **{f"rgb{bits}": _Pixels(bits, 3, cv2.COLOR_RGB2BGR) for bits in _BITS},
    **{f"bgra{bits}": _Pixels(bits, 4, cv2.COLOR_BGRA2BGR) for bits in _BITS},
    **{f"{bits}uc4": _Pixels(bits, 4, cv2.COLOR_BGRA2BGR) for bits in _BITS},
    **{f"rgba{bits}": _Pixels(bits, 4, cv2.COLOR_RGBA2BGR) for bits in _BITS},
    **{name: _Pixels(8, 3, None) for name in ("bgr", "bgr24", "bgr888")},
    **{name: _Pixels(8, 3, cv2.COLOR_RGB2BGR) for name in ("rgb", "rgb24", "rgb888")},
    **{
        f"bayer_{pattern}{bits}": _Pixels(bits, 1, code)
        for bits in _BITS
        for pattern, code in _BAYER.items()
    },
    **{name: _Pixels(8, 2, code) for code, names in _PACKED_YUV.items() for name in names},
}
_GREY: Final[dict[str, _Pixels]] = {
    **{name: _Pixels(8, 1, cv2.COLOR_GRAY2BGR) for name in ("mono8", "8uc1", "y8", "gray8")},
    **{name: _Pixels(16, 1, cv2.COLOR_GRAY2BGR) for name in ("mono16", "16uc1", "y16", "gray16")},
}
# 4:2:0: full rows of brightness, then half as many rows of colour.
_HALF_COLOUR: Final = {
    **dict.fromkeys(("nv12", "yuv420_nv12"), cv2.COLOR_YUV2BGR_NV12),
    **dict.fromkeys(("nv21", "yuv420_nv21"), cv2.COLOR_YUV2BGR_NV21),
    **dict.fromkeys(("i420", "iyuv", "yuv420", "yuv420p"), cv2.COLOR_YUV2BGR_I420),
    "yv12": cv2.COLOR_YUV2BGR_YV12,
}
_IN_PLANES: Final = (cv2.COLOR_YUV2BGR_I420, cv2.COLOR_YUV2BGR_YV12)
_DEPTH: Final = {
    "16uc1": "u2",
    "mono16": "u2",
    "y16": "u2",
    "z16": "u2",
    "16sc1": "i2",
    "32sc1": "i4",
    "32fc1": "f4",
    "64fc1": "f8",
}
_SENSOR_BITS: Final = (10, 12, 14, 16)

COLOUR_NAMES: Final = frozenset(_COLOUR) | frozenset(_HALF_COLOUR)
GREY_NAMES: Final = frozenset(_GREY)
DEPTH_NAMES: Final = frozenset(_DEPTH)


def plain_name(encoding: str) -> str:
    """The name of an encoding as the sets of this module have it."""
    return encoding.strip().lower()


def decode_depth_pixels(message: Any) -> NDArray[Any]:
    """(H, W) integers, float32 or float64 depth of an Image, in its own unit.

    Raises:
        ValueError: Its size, rows or encoding do not fit.
    """
    width, height = _size(message)
    name = plain_name(message.encoding)
    if name not in _DEPTH:
        raise ValueError(f"its encoding is {message.encoding!r}, expected {_listed(DEPTH_NAMES)}")
    values = _values(message, _DEPTH[name], width, height)
    if values.dtype.kind == "i":  # below 0 and the largest number are no reading
        usable = (values > 0) & (values < np.iinfo(values.dtype).max)
        values = np.where(usable, values, values.dtype.type(0))
    return values


class ColourPixels:
    """Decodes the colour images of one topic.

    Cameras of 10 to 14 bits give values of 16 bits that are not stretched. How many bits there are
    is told from the largest value so far.

    Attributes:
        bits: Bits of the values of 16 bits; 0 before the first.
    """

    def __init__(self) -> None:
        self.bits = 0

    def decode(self, message: Any) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 BGR of an Image.

        Raises:
            ValueError: Its size, rows or encoding do not fit.
        """
        width, height = _size(message)
        name = plain_name(message.encoding)
        if name in _HALF_COLOUR:
            return _half_colour(message, width, height, _HALF_COLOUR[name])
        pixels = _COLOUR.get(name) or _GREY.get(name)
        if pixels is None:
            raise ValueError(f"its encoding is {message.encoding!r}, expected {colour_names()}")
        values = _values(message, f"u{pixels.bits // 8}", width * pixels.channels, height)
        if pixels.bits > 8:
            largest = int(values.max())
            self.bits = max(self.bits, next(n for n in _SENSOR_BITS if largest < 2**n))
            values = (values >> (self.bits - 8)).astype(np.uint8)
        picture = np.array(values).reshape(height, width, pixels.channels)
        return picture if pixels.code is None else np.asarray(cv2.cvtColor(picture, pixels.code))


def colour_names() -> str:
    """The encodings of colour that are read, for messages."""
    return _listed((*_COLOUR, *_HALF_COLOUR, "mono8", "mono16"))


def depth_names() -> str:
    """The encodings of depth that are read, for messages."""
    return _listed(name.upper() if name[0].isdigit() else name for name in _DEPTH)


def _listed(names: Any) -> str:
    return ", ".join(names)


def _size(message: Any) -> tuple[int, int]:
    width, height = int(message.width), int(message.height)
    largest = current_limits().image_pixels
    if not 0 < width * height <= largest:
        raise ValueError(
            f"it is {width}x{height} px, expected 1 to {largest} pixels, the limit image_pixels"
        )
    return width, height


def _values(message: Any, kind: str, width: int, height: int) -> NDArray[Any]:
    """(height, width) values of a type, in the byte order of this machine."""
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    rows = _rows(message.data, width * dtype.itemsize, height, int(message.step))
    return np.ascontiguousarray(rows).view(dtype).astype(dtype.newbyteorder("="), copy=False)


def _half_colour(message: Any, width: int, height: int, code: int) -> NDArray[np.uint8]:
    if width % 2 or height % 2:
        raise ValueError(f"it is {width}x{height} px of {message.encoding}, expected even sides")
    rows, step = height * 3 // 2, int(message.step)
    if len(message.data) == width * rows:  # some drivers state the bytes of all planes as a row
        step = width
    if code in _IN_PLANES and step > width:
        light = _rows(message.data[: step * height], width, height, step)
        colour = _rows(message.data[step * height :], width // 2, height, step // 2)
        values = np.vstack([light, colour.reshape(-1, width)])
    else:
        values = _rows(message.data, width, rows, step)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(values), code), np.uint8)


def _rows(data: NDArray[np.uint8], width_bytes: int, height: int, step: int) -> NDArray[np.uint8]:
    """(height, width_bytes) the rows without their padding."""
    step = step or width_bytes
    before_last = step * (height - 1)
    if not width_bytes <= step <= len(data) or len(data) < before_last + width_bytes:
        raise ValueError(
            f"it has {len(data)} bytes in rows of {step}, expected {height} rows of {width_bytes}"
        )
    if len(data) >= step * height:
        return data[: step * height].reshape(height, step)[:, :width_bytes]
    rows = data[:before_last].reshape(height - 1, step)[:, :width_bytes]
    return np.vstack([rows, data[before_last : before_last + width_bytes]])  # without padding
