"""Orientation and focal length in EXIF metadata (CIPA DC-008, 4.6.4 and 4.6.5)."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

UPRIGHT = 1
INVERSE = {6: 8, 8: 6}  # of orientations; the others are their own
_ORIENTATION, _SHORT, _LONG, _RATIONAL = 274, 3, 4, 5
_MOST_ENTRIES = 4096
_EXIF_DIRECTORY = 34665
_FOCAL_MM, _EQUIVALENT_MM = 37386, 41989
_PLANE_PER_UNIT, _PLANE_UNIT, _STORED_WIDTH = 41486, 41488, 40962
_MM_PER_UNIT = {2: 25.4, 3: 10.0}
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
# Focal lengths in diagonals of the picture that lenses have.
_SHORTEST, _LONGEST = 0.1, 50.0

_WORDS = {
    2: "mirrored",
    3: "to be turned by 180 degrees",
    4: "mirrored top to bottom",
    5: "mirrored, to be turned by 90 degrees to the left",
    6: "to be turned by 90 degrees to the right",
    7: "mirrored, to be turned by 90 degrees to the right",
    8: "to be turned by 90 degrees to the left",
}


def read_orientation(exif: bytes) -> int:
    """Return the orientation, 1 to 8, in the TIFF structure of EXIF metadata; 1 if there is none.

    Args:
        exif: The metadata, without the mark "Exif" before them.
    """
    try:
        for tag, kind, value, _ in _entries(exif, _first_directory(exif)):
            if tag == _ORIENTATION and kind == _SHORT:
                return known_orientation(value)
    except struct.error:  # it ends early
        pass
    return UPRIGHT


def read_focal_px(exif: bytes, width: int, height: int) -> float | None:
    """Return the focal length in px of a picture of a size, as EXIF metadata state it.

    It is that of the 35 mm equivalent, by the diagonal of the picture, or else the focal length
    times the pixels per millimetre of the sensor.

    Args:
        exif: The metadata, without the mark "Exif" before them.
        width: Width of the picture in px.
        height: Its height.

    Returns:
        The focal length; None if none is stated, or no lens has it.
    """
    diagonal_px = math.hypot(width, height)
    try:
        stated = _numbers(exif)
    except struct.error:  # it ends early
        return None
    focal_px = stated.get(_EQUIVALENT_MM, 0.0) / _FILM_DIAGONAL_MM * diagonal_px
    per_mm = stated.get(_PLANE_PER_UNIT, 0.0) / _MM_PER_UNIT.get(int(stated.get(_PLANE_UNIT, 2)), 1)
    if focal_px <= 0 and stated.get(_STORED_WIDTH, 0.0) > 0:
        scale = max(width, height) / stated[_STORED_WIDTH]
        focal_px = stated.get(_FOCAL_MM, 0.0) * per_mm * scale
    return focal_px if _SHORTEST < focal_px / diagonal_px < _LONGEST else None


def _numbers(exif: bytes) -> dict[int, float]:
    """The numbers of the directory of the photograph's data by their tags."""
    order = _order(exif)
    found: dict[int, float] = {}
    for tag, kind, _, place in _entries(exif, _first_directory(exif)):
        if tag != _EXIF_DIRECTORY or kind != _LONG:
            continue
        for name, kind_of, short, at in _entries(exif, place):
            if kind_of == _SHORT:
                found[name] = float(short)
            elif kind_of == _LONG:
                found[name] = float(at)
            elif kind_of == _RATIONAL:
                upper, lower = struct.unpack_from(f"{order}II", exif, at)
                found[name] = upper / lower if lower else 0.0
        break
    return found


def _order(exif: bytes) -> str:
    """The order of bytes; empty if it is not stated."""
    return {b"II": "<", b"MM": ">"}.get(exif[:2], "")


def _first_directory(exif: bytes) -> int:
    """Where the first directory begins; 0 if the metadata are not such."""
    order = _order(exif)
    return int(struct.unpack_from(f"{order}I", exif, 4)[0]) if order else 0


def _entries(exif: bytes, directory: int) -> Iterator[tuple[int, int, int, int]]:
    """Tag, kind, and value as a number of 16 and of 32 bits, of each entry of a directory."""
    order = _order(exif)
    if not order:
        return
    (count,) = struct.unpack_from(f"{order}H", exif, directory)
    for entry in range(min(count, _MOST_ENTRIES)):
        start = directory + 2 + 12 * entry
        tag, kind, _ = struct.unpack_from(f"{order}HHI", exif, start)
        (short,) = struct.unpack_from(f"{order}H", exif, start + 8)
        (value,) = struct.unpack_from(f"{order}I", exif, start + 8)
        yield tag, kind, short, value


def known_orientation(value: int) -> int:
    """Return an orientation that a file states, or 1 if there is no such orientation."""
    return value if value in _WORDS else UPRIGHT


def orientation_words(orientation: int) -> str:
    """Say in words how the stored pixels are to be turned.

    Examples:
        >>> orientation_words(6)
        'EXIF orientation 6, to be turned by 90 degrees to the right'
    """
    words = f", {_WORDS[orientation]}" if orientation in _WORDS else ""
    return f"EXIF orientation {orientation}{words}"


def turned_upright(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Turn stored pixels (H, W) or (H, W, channels) as an EXIF orientation says."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels.copy()
