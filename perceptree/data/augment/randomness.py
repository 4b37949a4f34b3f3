"""Fast random numbers and fields."""

from __future__ import annotations

from statistics import NormalDist
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Bool, Float32, UInt8

ZERO_LEVEL = 128
"""The value of 0 in `normal_levels`."""
_NORMAL = NormalDist()
_QUANTILES = np.array([_NORMAL.inv_cdf((row + 0.5) / 256) for row in range(256)], np.float32)


def is_drawn(rng: np.random.Generator, share: float) -> bool:
    """Return True with probability `share`; draws nothing if the result is certain."""
    return share >= 1 or (share > 0 and bool(rng.random() < share))


def uniform_up_to(rng: np.random.Generator, limit: float) -> float:
    """Draw uniformly from 0 to `limit`; draws nothing if it is 0."""
    return float(rng.uniform(0, limit)) if limit > 0 else 0.0


def uniform_symmetric(rng: np.random.Generator, limit: float) -> float:
    """Draw uniformly from `-limit` to `limit`; draws nothing if it is 0."""
    return float(rng.uniform(-limit, limit)) if limit > 0 else 0.0


def normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Float32:
    """Draw standard normal values, quantised to 256 equally likely values up to 2.9."""
    return np.asarray(cv2.LUT(_bytes(rng, shape), _QUANTILES), np.float32)


def normal_levels(rng: np.random.Generator, shape: tuple[int, ...], deviation: float) -> UInt8:
    """Draw normal values rounded to integers, plus 128 (uint8), for `add_levels`."""
    table = np.clip(np.rint(ZERO_LEVEL + deviation * _QUANTILES), 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(_bytes(rng, shape), table), np.uint8)


def add_levels(image: UInt8, levels: UInt8) -> UInt8:
    """Add the noise of `normal_levels` to a uint8 image, clipped to 0 to 255."""
    return np.asarray(cv2.addWeighted(image, 1, levels, 1, -ZERO_LEVEL), np.uint8)


def smooth_field(rng: np.random.Generator, height: int, width: int, cell_px: float) -> Float32:
    """Return (height, width) approximately standard normal values, smooth over `cell_px`."""
    field = np.zeros((height, width), np.float32)
    for octave, weight in ((1, 1.2), (3, 0.5)):
        rows, columns = (max(2, round(side * octave / cell_px) + 1) for side in (height, width))
        coarse = np.asarray(rng.standard_normal((rows, columns), np.float32) * weight)
        cv2.add(field, cv2.resize(coarse, (width, height)), dst=field)
    return field


def blobs(rng: np.random.Generator, shape: tuple[int, int], share: float, cell_px: float) -> Bool:
    """Return (H, W) irregular patches that cover about `share` of the image."""
    if share <= 0:
        return np.zeros(shape, bool)
    threshold = _NORMAL.inv_cdf(1 - share) if share < 1 else -np.inf
    return np.asarray(smooth_field(rng, *shape, cell_px) > threshold)


def _bytes(rng: np.random.Generator, shape: tuple[int, ...]) -> UInt8:
    count = int(np.prod(shape))
    words: NDArray[Any] = rng.integers(0, 2**64 - 1, -(-count // 8), dtype=np.uint64, endpoint=True)
    return words.astype("<u8", copy=False).view(np.uint8)[:count].reshape(shape)
