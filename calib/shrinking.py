"""Shrink images by area averaging, as OpenCV does and in about half its time."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import cv2
import numpy as np

from basetree.arrays import Float32, UInt8

_MOST_ROWS: Final = 80
"""Rows of a block up to which multiplying by all of its weights is faster than OpenCV.
Source: benchmarks/results/shrinking.json."""
_AT_ONCE: Final = 2**19
"""Values that are averaged at once, so that they stay in a core's cache.
Source: benchmarks/results/shrinking.json."""


def shrink(image: UInt8, width: int, height: int) -> UInt8:
    """Shrink an image; each new pixel is the mean of the area that it covers.

    `cv2.resize` with `INTER_AREA` gives the same, but works pixel by pixel unless both sides shrink
    by a whole number. Here rows are averaged first, by a matrix product: from 720 to 450 px, each
    block of 8 rows becomes 5. Then OpenCV averages the columns. A pixel differs from OpenCV's by at
    most one grey level, where its mean lies half way between two.

    Args:
        image: (H, W) or (H, W, C) uint8.
        width: Width of the result in px, at most W.
        height: Height of the result in px, at most H.

    Returns:
        (height, width) or (height, width, C) uint8.
    """
    rows, columns = image.shape[:2]
    blocks = math.gcd(rows, height)
    block, averaged = rows // blocks, height // blocks
    if (rows % height == 0 and columns % width == 0) or not averaged < block <= _MOST_ROWS:
        return np.asarray(
            cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8
        )
    weights = _weights(block, averaged)
    by_block = image.reshape(blocks, block, -1)
    step = max(1, _AT_ONCE // by_block[0].size)
    shrunk = np.empty((height, width, *image.shape[2:]), np.uint8)
    for start in range(0, blocks, step):
        means = np.matmul(weights, by_block[start : start + step].astype(np.float32))
        few_rows = means.reshape(-1, *image.shape[1:])
        few = cv2.resize(few_rows, (width, len(few_rows)), interpolation=cv2.INTER_AREA)
        first = start * averaged
        shrunk[first : first + len(few)] = np.rint(few, out=few)
    return shrunk


@lru_cache(maxsize=16)
def _weights(rows: int, averaged: int) -> Float32:
    """(averaged, rows) weights of the rows of a block in the fewer rows that cover it."""
    size = rows / averaged
    first, after = np.arange(rows), np.arange(1, rows + 1)
    start, end = size * np.arange(averaged)[:, None], size * np.arange(1, averaged + 1)[:, None]
    covered = np.minimum(end, after) - np.maximum(start, first)
    return np.asarray(np.maximum(covered, 0) / size, np.float32)
