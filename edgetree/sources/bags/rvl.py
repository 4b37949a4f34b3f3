"""Decode RVL, a lossless code for depth.

Wilson 2017, Fast lossless depth image compression (ACM ISS): numbers of pixels without and with a
reading take turns, each followed by the changes from reading to reading. Numbers are written in
groups of 3 bits, the lowest first, with a fourth bit where another group follows; eight of these
nibbles make a little-endian word of 32 bits, the first one at its top.
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from basetree.files.limits import current_limits

_SIZE: Final = struct.Struct("<ii")
_MOST_NIBBLES: Final = 10  # of a number: 30 bits, where pixels need 28 and changes 17
_SHIFTS: Final = np.arange(28, -1, -4, dtype=np.uint32)


def decode_rvl(data: bytes) -> NDArray[np.uint16]:
    """Decode a picture of depth: its width and height, 32 bits each, and its code.

    Returns:
        (H, W) depth in its own unit; 0 for no reading.

    Raises:
        ValueError: The size is above the limit or the code does not fit it.
    """
    if len(data) < _SIZE.size:
        raise ValueError(f"it has {len(data)} bytes, expected the size of an RVL picture")
    width, height = _SIZE.unpack_from(data)
    largest = current_limits().image_pixels
    if not (width > 0 and height > 0 and width * height <= largest):
        raise ValueError(f"its RVL code is of {width}x{height} px, expected 1 to {largest} pixels")
    numbers = _numbers(data[_SIZE.size :])
    starts, counts, first = _runs(numbers.tolist(), width * height)
    # Place of each reading in the picture, and of its change in the code.
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    coded = numbers[np.repeat(first, counts) + within].astype(np.int64)
    changes = (coded >> 1) ^ -(coded & 1)
    depth = np.zeros(width * height, np.uint16)
    depth[np.repeat(starts, counts) + within] = (np.cumsum(changes) & 0xFFFF).astype(np.uint16)
    return depth.reshape(height, width)


def _numbers(code: bytes) -> NDArray[np.uint32]:
    """All numbers of the code, in order."""
    words = np.frombuffer(code + bytes(-len(code) % 4), "<u4")
    nibbles = (words[:, None] >> _SHIFTS & 15).astype(np.uint8).ravel()
    ends = np.flatnonzero(nibbles < 8)
    starts = np.concatenate([[0], ends[:-1] + 1]).astype(np.int64)[: len(ends)]
    lengths = ends - starts + 1
    if lengths.max(initial=0) > _MOST_NIBBLES:
        raise ValueError(f"a number of its RVL code has more than {_MOST_NIBBLES} groups of bits")
    values = np.zeros(len(ends), np.uint32)
    for group in range(lengths.max(initial=0)):
        there = lengths > group
        values[there] |= (nibbles[starts[there] + group] & 7).astype(np.uint32) << (3 * group)
    return values


def _runs(
    numbers: list[int], pixels: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Starts and counts of the runs of readings, and where their changes begin in the code."""
    starts, counts, first = [], [], []
    pixel = at = 0
    while pixel < pixels:
        if at + 1 >= len(numbers):
            raise ValueError(f"its RVL code ends after {pixel} of {pixels} pixels")
        empty, count = numbers[at], numbers[at + 1]
        pixel, at = pixel + empty, at + 2
        if pixel + count > pixels or (empty == count == 0 and pixel) or at + count > len(numbers):
            raise ValueError(f"its RVL code does not fit {pixels} pixels")
        starts.append(pixel)
        counts.append(count)
        first.append(at)
        pixel, at = pixel + count, at + count
    return np.array(starts), np.array(counts), np.array(first)
