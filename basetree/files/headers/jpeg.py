"""JPEG (ITU-T T.81): the frame header wherever it is, and the scans."""

from __future__ import annotations

import struct
from typing import NamedTuple

from basetree.files.headers.exif import read_focal_px, read_orientation
from basetree.files.headers.header import PictureHeader

_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOF0 to SOF15
_BARE = frozenset((0x01, *range(0xD0, 0xD9)))  # markers without a length
_SCAN, _END, _APP1 = 0xDA, 0xD9, 0xE1
_EXIF = b"Exif\0\0"
_MOST_SCANS = 100  # a progressive picture has about ten; each goes through all its pixels
_MOST_SEGMENTS = 2**16


class _Frame(NamedTuple):
    width: int
    height: int
    components: int
    samples_per_px: float  # of all components together, with their subsampling


def read_header(data: bytes) -> PictureHeader | None:
    """Follow the segments to the first scan, as the decoder does; None if there is no frame."""
    position, exif = 2, b""
    frame: _Frame | None = None
    for _ in range(_MOST_SEGMENTS):
        position, marker = _next_marker(data, position)
        if marker in _BARE:
            continue
        if marker == _END:
            return None
        (length,) = struct.unpack_from(">H", data, position)
        if marker == _SCAN:
            return None if frame is None else _header(data, position, frame, exif)
        if marker in _FRAMES:
            frame = frame or _read_frame(data, position)
        elif marker == _APP1 and data.startswith(_EXIF, position + 2):
            exif = exif or data[position + 8 : position + length]
        position += length
    return None


def _next_marker(data: bytes, position: int) -> tuple[int, int]:
    """The position behind the next marker, and the marker; other bytes before it are skipped."""
    while True:
        position = data.find(b"\xff", position)
        if position < 0:
            raise struct.error("no further marker")
        while data[position : position + 1] == b"\xff":
            position += 1
        if position >= len(data):
            raise struct.error("no further marker")
        if data[position]:
            return position + 1, data[position]


def _read_frame(data: bytes, position: int) -> _Frame:
    height, width, components = struct.unpack_from(">HHB", data, position + 3)
    factors = [
        struct.unpack_from("B", data, position + 9 + 3 * index)[0] for index in range(components)
    ]
    areas = [(factor >> 4) * (factor & 15) for factor in factors]
    return _Frame(width, height, components, sum(areas) / max([1, *areas]))


def _header(data: bytes, position: int, frame: _Frame, exif: bytes) -> PictureHeader | None:
    """The header of a picture whose first scan is at a position.

    A decoder keeps the coefficients of the whole picture, 2 bytes each, if a scan does not hold
    all of them.
    """
    scans, coefficient_bytes = 1, 0
    pixels = frame.width * frame.height
    in_first_scan, *_ = struct.unpack_from("B", data, position + 2)
    first_and_last = data[position + 3 + 2 * in_first_scan : position + 5 + 2 * in_first_scan]
    if in_first_scan != frame.components or first_and_last != b"\x00\x3f":
        scans = data.count(b"\xff\xda", position) + 1
        coefficient_bytes = int(2 * frame.samples_per_px * pixels)
    if scans > _MOST_SCANS:
        return None
    channels = 1 if frame.components == 1 else 3
    return PictureHeader(
        *("JPEG", frame.width, frame.height, channels, 1, coefficient_bytes),
        orientation=read_orientation(exif),
        focal_px=read_focal_px(exif, frame.width, frame.height),
    )
