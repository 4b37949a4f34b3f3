"""Decode RVL, a lossless code for depth.

Wilson 2017, Fast lossless depth image compression (ACM ISS): numbers of pixels without and with a
reading take turns, each followed by the changes from reading to reading. Numbers are written in
groups of 3 bits, the lowest first, with a fourth bit where another group follows; eight of these
nibbles make a little-endian word of 32 bits, the first one at its top.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from basetree.files.limits import current_limits

_SIZE: Final = struct.Struct("<ii")
_MOST_NIBBLES: Final = 10  # of a number: 30 bits, where pixels need 28 and changes 17
_MOST_BYTES: Final = 4  # of a pixel: a change of 6 nibbles between two runs of one
_BLOCK: Final = 2**20  # bytes of code and readings that are decoded at once


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
    pixels, largest = width * height, current_limits().image_pixels
    if not (width > 0 and height > 0 and pixels <= largest):
        raise ValueError(f"its RVL code is of {width}x{height} px, expected 1 to {largest} pixels")
    numbers = _numbers(data[_SIZE.size : _SIZE.size + _MOST_BYTES * (pixels + _MOST_NIBBLES)])
    depth = np.zeros(pixels, np.uint16)
    last = 0
    for starts, counts, first in _runs(numbers, pixels):
        # Place of each reading in the picture, and of its change in the code.
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        coded = numbers[np.repeat(first, counts) + within].astype(np.int64)
        readings = last + np.cumsum((coded >> 1) ^ -(coded & 1))
        depth[np.repeat(starts, counts) + within] = (readings & 0xFFFF).astype(np.uint16)
        last = int(readings[-1]) if len(readings) else last
    return depth.reshape(height, width)


def _numbers(code: bytes) -> NDArray[np.uint32]:
    """All numbers of the code, in order."""
    code += bytes(-len(code) % 4)
    numbers, rest = [np.zeros(0, np.uint32)], np.zeros(0, np.uint8)
    for start in range(0, len(code), _BLOCK):
        halves = np.frombuffer(code[start : start + _BLOCK], "<u4").astype(">u4").view(np.uint8)
        nibbles = np.concatenate([rest, np.stack([halves >> 4, halves & 15], -1).ravel()])
        ends = np.flatnonzero(nibbles < 8) + 1
        numbers.append(_joined(nibbles, ends))
        rest = nibbles[ends[-1] if len(ends) else 0 :]
    return np.concatenate(numbers)


def _joined(nibbles: NDArray[np.uint8], ends: NDArray[np.intp]) -> NDArray[np.uint32]:
    """The numbers whose nibbles end there."""
    starts = np.concatenate([[0], ends[:-1]])[: len(ends)]
    lengths = ends - starts
    if max(lengths.max(initial=0), len(nibbles) if not len(ends) else 0) > _MOST_NIBBLES:
        raise ValueError(f"a number of its RVL code has more than {_MOST_NIBBLES} groups of bits")
    values = np.zeros(len(ends), np.uint32)
    for group in range(lengths.max(initial=0)):
        there = np.flatnonzero(lengths > group)
        values[there] |= (nibbles[starts[there] + group] & 7).astype(np.uint32) << (3 * group)
    return values


def _runs(numbers: NDArray[np.uint32], pixels: int) -> Iterator[NDArray[np.int64]]:
    """Yield blocks of runs of readings: starts, counts, and where their changes are in the code."""
    coded, size = numbers.data, len(numbers)  # faster than the array, number by number
    runs: list[tuple[int, int, int]] = []
    pixel = at = waiting = 0
    while pixel < pixels:
        if at + 1 >= size:
            raise ValueError(f"its RVL code ends after {pixel} of {pixels} pixels")
        empty, count = coded[at], coded[at + 1]
        pixel, at = pixel + empty, at + 2
        if pixel + count > pixels or empty == count == 0 or at + count > size:
            raise ValueError(f"its RVL code does not fit {pixels} pixels")
        for part in range(0, count, _BLOCK):
            runs.append((pixel + part, min(count - part, _BLOCK), at + part))
            waiting += runs[-1][1]
            if waiting >= _BLOCK:
                yield np.array(runs).T
                runs, waiting = [], 0
        pixel, at = pixel + count, at + count
    if runs:
        yield np.array(runs).T
