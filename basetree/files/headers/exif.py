"""The orientation in EXIF metadata (CIPA DC-008, 4.6.4), and pixels turned by it."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

UPRIGHT = 1
_ORIENTATION, _SHORT = 274, 3
_MOST_ENTRIES = 4096

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
    order = {b"II": "<", b"MM": ">"}.get(exif[:2])
    if order is None:
        return UPRIGHT
    try:
        (directory,) = struct.unpack_from(f"{order}I", exif, 4)
        (count,) = struct.unpack_from(f"{order}H", exif, directory)
        for entry in range(min(count, _MOST_ENTRIES)):
            tag, kind, _, value = struct.unpack_from(
                f"{order}HHIH", exif, directory + 2 + 12 * entry
            )
            if tag == _ORIENTATION and kind == _SHORT:
                return known_orientation(value)
    except struct.error:  # it ends early
        pass
    return UPRIGHT


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
