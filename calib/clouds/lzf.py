"""Decompress LZF, as in compressed PCD files.

A control byte below 32 says that so many bytes and one more follow as they are. Otherwise its
upper three bits are a length and its lower five, with another byte, a distance backwards: these
bytes are repeated. A length of 7 goes on in a further byte; lengths count from 2.
Format: the documentation of LibLZF, http://software.schmorp.de/pkg/liblzf.html.
"""

from __future__ import annotations

from typing import Final

_MOST_LITERALS: Final = 32
_LONG: Final = 7


def decompress(data: bytes, size: int) -> bytes:
    """Decompress LZF data.

    Args:
        data: The compressed bytes.
        size: Number of bytes that they hold.

    Raises:
        ValueError: If the data is damaged or holds another number of bytes.
    """
    out = bytearray()
    at, end = 0, len(data)
    try:
        while at < end:
            control = data[at]
            at += 1
            if control < _MOST_LITERALS:
                out += data[at : at + control + 1]
                at += control + 1
            else:
                length = control >> 5
                if length == _LONG:
                    length += data[at]
                    at += 1
                start = len(out) - ((control & 31) << 8) - data[at] - 1
                at += 1
                _repeat(out, start, length + 2)
            if len(out) > size:
                break
    except IndexError as error:
        raise ValueError("the compressed data ends too early") from error
    if at > end or len(out) != size:
        raise ValueError(f"the compressed data holds {len(out)} bytes and not {size}")
    return bytes(out)


def _repeat(out: bytearray, start: int, length: int) -> None:
    """Append `length` bytes from `start` on, which may be among those that are appended."""
    if start < 0:
        raise ValueError("the compressed data refers to bytes before its beginning")
    part = out[start : start + length]
    if len(part) < length:
        part = (part * (length // len(part) + 1))[:length]
    out += part
