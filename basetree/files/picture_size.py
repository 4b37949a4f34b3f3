"""Read the size of a picture from its header, before memory for its pixels is taken."""

from __future__ import annotations

import struct
from pathlib import Path

from basetree.errors import InputFileError
from basetree.files.limits import current_limits

_PNG = b"\x89PNG\r\n\x1a\n"
_HEADER_BYTES = 2**18  # a JPEG's size may come after its embedded thumbnail
_JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # the markers SOF0 to SOF15
_JPEG_BARE = frozenset((0x01, *range(0xD0, 0xD9)))  # markers without a length
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257


def check_picture_size(path: Path | str) -> None:
    """Check that a picture has no more pixels than `Limits.image_pixels`.

    The size is read from the header of PNG, JPEG, TIFF, BMP and WebP files; files of other kinds
    and unreadable ones are accepted, for the reader to refuse.

    Raises:
        InputFileError: If it has more.
    """
    try:
        with Path(path).open("rb") as file:
            size = picture_size(file.read(_HEADER_BYTES))
    except (OSError, ValueError):
        return
    largest = current_limits().image_pixels
    if size is not None and size[0] * size[1] > largest:
        raise InputFileError(
            f"{path}: {size[0]}x{size[1]} px, expected at most {largest} pixels, the limit"
            " image_pixels"
        )


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height in px that a picture's header states; None if it states none.

    Args:
        data: The beginning of the file, of PNG, JPEG, TIFF, BMP or WebP.
    """
    try:
        if data.startswith(_PNG):
            width, height = struct.unpack_from(">II", data, 16)
        elif data.startswith(b"\xff\xd8"):
            return _jpeg_size(data)
        elif data[:4] in (b"II*\0", b"MM\0*"):
            return _tiff_size(data, "<" if data[:2] == b"II" else ">")
        elif data.startswith(b"BM"):
            width, height = (abs(side) for side in struct.unpack_from("<ii", data, 18))
        elif data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp_size(data)
        else:
            return None
    except struct.error:  # the header ends early
        return None
    return width, height


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Follow the segments to the frame header (ITU-T T.81, B.2.2)."""
    position = 2
    while position + 4 <= len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", data, position + 5)
            return width, height
        bare = marker in _JPEG_BARE or marker == 0xFF
        step = 0 if bare else struct.unpack_from(">H", data, position + 2)[0]
        position += (1 if marker == 0xFF else 2) + step
    return None


def _tiff_size(data: bytes, order: str) -> tuple[int, int] | None:
    """Read the tags ImageWidth and ImageLength of the first directory (TIFF 6.0, section 2)."""
    (directory,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, directory)
    sides: dict[int, int] = {}
    for entry in range(count):
        position = directory + 2 + 12 * entry
        tag, kind = struct.unpack_from(f"{order}HH", data, position)
        layout = f"{order}H" if kind == 3 else f"{order}I"
        sides[tag] = struct.unpack_from(layout, data, position + 8)[0]
    if _TIFF_WIDTH not in sides or _TIFF_HEIGHT not in sides:
        return None
    return sides[_TIFF_WIDTH], sides[_TIFF_HEIGHT]


def _webp_size(data: bytes) -> tuple[int, int] | None:
    """Read the size of the first chunk: lossy, lossless or extended (RFC 9649)."""
    kind = data[12:16]
    if kind == b"VP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
        return width, height
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 ":
        width, height = (side & 0x3FFF for side in struct.unpack_from("<HH", data, 26))
        return width, height
    return None
