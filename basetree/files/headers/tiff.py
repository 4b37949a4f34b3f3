"""TIFF 6.0 and BigTIFF: the first directory, checked against the bytes that are there."""

from __future__ import annotations

import struct
import sys
from array import array
from operator import add
from typing import NamedTuple

from basetree.files.headers.exif import UPRIGHT, known_orientation
from basetree.files.headers.header import NotOffered, PictureHeader

_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _ORIENTATION = 256, 257, 258, 259, 274
_SUBFILE, _SAMPLES, _ROWS_PER_STRIP, _PLANES, _DNG = 254, 277, 278, 284, 50706
_STRIP_STARTS, _STRIP_BYTES = 273, 279
_TILE_WIDTH, _TILE_HEIGHT, _TILE_STARTS, _TILE_BYTES = 322, 323, 324, 325
_PREVIEW, _SEPARATE = 1, 2
_JPEG = 7
_COMPRESSIONS = (1, 5, _JPEG, 8, 32773, 32946)  # none, LZW, JPEG, deflate, PackBits, deflate
_MOST_ENTRIES = 4096
_RGBA_BYTES = 4  # a strip or tile is decoded as such, then made colour or grey
_BYTES_OF = {
    **dict.fromkeys((1, 2, 6, 7), 1),
    **dict.fromkeys((3, 8), 2),
    **dict.fromkeys((4, 9, 11, 13), 4),
    **dict.fromkeys((5, 10, 12, 16, 17, 18), 8),
}
_WHOLE_NUMBERS = {1: "B", 3: "H", 4: "I", 16: "Q"}


class _Layout(NamedTuple):
    """How numbers are stored in classic TIFF or BigTIFF."""

    order: str
    start: str  # of the file: the offset of the first directory
    start_at: int
    entries: str
    entry: str
    inline_bytes: int


class _Directory:
    """The entries of a directory whose values are whole numbers.

    Attributes:
        places: Where the values of a tag begin.
    """

    def __init__(self) -> None:
        self._values: dict[int, array[int]] = {}
        self.places: dict[int, int] = {}

    def __contains__(self, tag: int) -> bool:
        return tag in self._values

    def add(self, tag: int, values: array[int], place: int) -> bool:
        """Add an entry whose values are at a place; False if it is repeated."""
        is_new = tag not in self._values
        self._values[tag], self.places[tag] = values, place
        return is_new

    def all(self, tag: int) -> array[int]:
        """All values of an entry, empty if it is missing."""
        return self._values.get(tag, array("B"))

    def one(self, tag: int, otherwise: int) -> int:
        """The first value of an entry."""
        values = self.all(tag)
        return values[0] if values else otherwise


def read_header(data: bytes) -> PictureHeader | None:
    """Read the header of the first picture; None if it states bytes that are not there.

    Raises:
        NotOffered: If it is a preview, as in camera raw files, or packed in another way.
    """
    directory = _read_directory(data)
    if directory is None or _WIDTH not in directory or _HEIGHT not in directory:
        return None
    if _DNG in directory or directory.one(_SUBFILE, 0) & _PREVIEW:
        raise NotOffered(
            "a camera raw file or one that begins with a preview, expected a TIFF whose first"
            " picture is the whole one: convert it to PNG or JPEG"
        )
    compression = directory.one(_COMPRESSION, 1)
    if compression not in _COMPRESSIONS:
        raise NotOffered(
            f"a TIFF of compression {compression}, expected none, LZW, deflate, PackBits or JPEG:"
            " convert it to PNG"
        )
    width, height = directory.one(_WIDTH, 0), directory.one(_HEIGHT, 0)
    block = _block_pixels(directory, width, height, len(data))
    if block is None:
        return None
    orientation = known_orientation(directory.one(_ORIENTATION, UPRIGHT))
    channels, bits = directory.one(_SAMPLES, 1), directory.all(_BITS)
    sample_bytes = (max(bits, default=1) + 7) // 8
    block_bytes = block * (channels * sample_bytes + _RGBA_BYTES)
    name = "TIFF with JPEG" if compression == _JPEG else "TIFF"
    return PictureHeader(name, width, height, channels, sample_bytes, block_bytes, orientation)


def as_stored(data: bytes) -> bytes:
    """A TIFF that states no orientation: OpenCV turns its pixels whatever the flags say."""
    directory = _read_directory(data)
    if directory is None or not directory.all(_ORIENTATION):
        return data
    value = UPRIGHT.to_bytes(
        directory.all(_ORIENTATION).itemsize, "little" if data[:2] == b"II" else "big"
    )
    place = directory.places[_ORIENTATION]
    return data[:place] + value + data[place + len(value) :]


def _read_directory(data: bytes) -> _Directory | None:
    """The first directory; None if an entry is repeated or lies outside of the file."""
    order = "<" if data[:2] == b"II" else ">"
    layout = _Layout(order, "I", 4, "H", "HHI", 4)
    if 43 in data[2:4]:  # BigTIFF
        if struct.unpack_from(f"{order}HH", data, 4) != (8, 0):
            return None
        layout = _Layout(order, "Q", 8, "Q", "HHQ", 8)
    (position,) = struct.unpack_from(order + layout.start, data, layout.start_at)
    if position >= len(data):
        return None
    (count,) = struct.unpack_from(order + layout.entries, data, position)
    position += struct.calcsize(order + layout.entries)
    directory = _Directory()
    entry_bytes = struct.calcsize(order + layout.entry) + layout.inline_bytes
    if count > _MOST_ENTRIES or position + count * entry_bytes > len(data):
        return None
    for at in range(position, position + count * entry_bytes, entry_bytes):
        if not _add_entry(directory, data, layout, at):
            return None
    return directory


def _add_entry(directory: _Directory, data: bytes, layout: _Layout, at: int) -> bool:
    """Read an entry; False if its values lie outside of the file, or its tag is repeated."""
    tag, kind, count = struct.unpack_from(layout.order + layout.entry, data, at)
    if kind not in _BYTES_OF:
        return True
    start = at + struct.calcsize(layout.order + layout.entry)
    size = count * _BYTES_OF[kind]
    if size > layout.inline_bytes:
        (start,) = struct.unpack_from(layout.order + layout.start, data, start)
    if start + size > len(data):
        return False
    if kind not in _WHOLE_NUMBERS:
        return True
    values = array(_WHOLE_NUMBERS[kind], data[start : start + size])
    if (layout.order == "<") != (sys.byteorder == "little"):
        values.byteswap()
    return directory.add(tag, values, start)


def _block_pixels(directory: _Directory, width: int, height: int, size: int) -> int | None:
    """Pixels of the largest strip or tile; None if their places do not fit the picture or file."""
    if _TILE_WIDTH in directory or _TILE_STARTS in directory:
        sides = directory.one(_TILE_WIDTH, 0), directory.one(_TILE_HEIGHT, 0)
        starts, sizes = directory.all(_TILE_STARTS), directory.all(_TILE_BYTES)
    else:
        sides = width, min(directory.one(_ROWS_PER_STRIP, height), height)
        starts, sizes = directory.all(_STRIP_STARTS), directory.all(_STRIP_BYTES)
    if min(sides) < 1 or len(starts) == 0 or len(starts) != len(sizes):
        return None
    blocks = -(-width // sides[0]) * -(-height // sides[1])
    if directory.one(_PLANES, 1) == _SEPARATE:
        blocks *= directory.one(_SAMPLES, 1)
    if len(starts) != blocks or max(map(add, starts, sizes)) > size:
        return None
    return sides[0] * sides[1]
