"""WebP (RFC 9649): the first chunk, and the orientation."""

from __future__ import annotations

import struct

from basetree.files.headers.exif import UPRIGHT, read_orientation
from basetree.files.headers.header import PictureHeader

_BYTES_PER_PX, _ANIMATED_BYTES_PER_PX = 8, 16  # of the decoder
_EXIF_FLAG, _ANIMATION_FLAG = 0x08, 0x02
_MOST_CHUNKS = 1000


def read_header(data: bytes) -> PictureHeader | None:
    """Read the header of a lossy, lossless or extended file; None if its end is missing."""
    (length,) = struct.unpack_from("<I", data, 4)
    if data[8:12] != b"WEBP" or length + 8 > len(data):
        return None
    kind, orientation, flags = data[12:16], UPRIGHT, 0
    if kind == b"VP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
        flags = data[20]
        if flags & _EXIF_FLAG:
            orientation = _orientation(data)
    elif kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    elif kind == b"VP8 ":
        width, height = (side & 0x3FFF for side in struct.unpack_from("<HH", data, 26))
    else:
        return None
    per_px = _ANIMATED_BYTES_PER_PX if flags & _ANIMATION_FLAG else _BYTES_PER_PX
    return PictureHeader("WebP", width, height, 4, 1, width * height * per_px, orientation)


def _orientation(data: bytes) -> int:
    position = 12
    for _ in range(_MOST_CHUNKS):
        if position + 8 > len(data):
            break
        kind, length = struct.unpack_from("<4sI", data, position)
        if kind == b"EXIF":
            exif = data[position + 8 : position + 8 + length]
            return read_orientation(exif.removeprefix(b"Exif\0\0"))
        position += 8 + length + length % 2
    return UPRIGHT
