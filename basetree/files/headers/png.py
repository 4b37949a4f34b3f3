"""PNG (W3C PNG, third edition): the header and the chain of chunks."""

from __future__ import annotations

import struct

from basetree.files.headers.exif import UPRIGHT, read_orientation
from basetree.files.headers.header import PictureHeader

_CHUNK = struct.Struct(">I4s")
_MOST_CHUNKS = 2**20
_CHANNELS = {0: 1, 2: 3, 3: 4, 4: 4, 6: 4}  # by colour type, as decoded


def read_header(data: bytes) -> PictureHeader | None:
    """Read the header; the picture is whole if its chunks reach their end within the file."""
    kind, width, height, bits, colour = struct.unpack_from(">4sIIBB", data, 12)
    if kind != b"IHDR" or colour not in _CHANNELS:
        return None
    orientation = _orientation(data)
    return PictureHeader(
        "PNG",
        width,
        height,
        _CHANNELS[colour],
        max(1, bits // 8),
        orientation=orientation or UPRIGHT,
        is_whole=orientation is not None,
    )


def _orientation(data: bytes) -> int | None:
    """Follow the chunks to their end; None if one states more bytes than there are."""
    position, orientation = 8, UPRIGHT
    for _ in range(_MOST_CHUNKS):
        if position + 12 > len(data):
            return None
        length, kind = _CHUNK.unpack_from(data, position)
        end = position + 12 + length
        if kind == b"IEND":
            return orientation if end <= len(data) else None
        if kind == b"eXIf":
            orientation = read_orientation(data[position + 8 : end - 4])
        position = end
    return None
