"""Random fields that are drawn fast, and from the given generator alone."""

from __future__ import annotations

from statistics import NormalDist
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]

ZERO_LEVEL = 128
"""The level that stands for 0 in :func:`normal_levels`."""
_NORMAL = NormalDist()
_QUANTILES = np.array([_NORMAL.inv_cdf((row + 0.5) / 256) for row in range(256)], np.float32)


def happens(rng: np.random.Generator, share: float) -> bool:
    """True in ``share`` of the calls; draws nothing where that is certain."""
    return share >= 1 or (share > 0 and bool(rng.random() < share))


def strength(rng: np.random.Generator, most: float) -> float:
    """Evenly from 0 to ``most``; draws nothing for 0."""
    return float(rng.uniform(0, most)) if most > 0 else 0.0


def either_side(rng: np.random.Generator, most: float) -> float:
    """Evenly from ``-most`` to ``most``; draws nothing for 0."""
    return float(rng.uniform(-most, most)) if most > 0 else 0.0


def normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Float32:
    """Standard normal values, at 256 evenly likely places up to 2.9."""
    return np.asarray(cv2.LUT(_bytes(rng, shape), _QUANTILES), np.float32)


def normal_levels(
    rng: np.random.Generator, shape: tuple[int, ...], deviation: float
) -> NDArray[np.uint8]:
    """Normal values in whole levels, plus 128: cv2.addWeighted adds them at the speed of bytes."""
    table = np.clip(np.rint(ZERO_LEVEL + deviation * _QUANTILES), 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(_bytes(rng, shape), table), np.uint8)


def add_levels(image: NDArray[np.uint8], levels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image plus what :func:`normal_levels` drew, kept within 0 to 255."""
    return np.asarray(cv2.addWeighted(image, 1, levels, 1, -ZERO_LEVEL), np.uint8)


def smooth_field(rng: np.random.Generator, height: int, width: int, cell_px: float) -> Float32:
    """(height, width) of about standard normal values that change over about ``cell_px``."""
    field = np.zeros((height, width), np.float32)
    for octave, weight in ((1, 1.2), (3, 0.5)):
        rows, columns = (max(2, round(side * octave / cell_px) + 1) for side in (height, width))
        coarse = np.asarray(rng.standard_normal((rows, columns), np.float32) * weight)
        cv2.add(field, cv2.resize(coarse, (width, height)), dst=field)
    return field


def blobs(
    rng: np.random.Generator, shape: tuple[int, int], share: float, cell_px: float
) -> NDArray[np.bool_]:
    """(H, W) irregular patches that fill about ``share`` of the picture."""
    if share <= 0:
        return np.zeros(shape, bool)
    threshold = _NORMAL.inv_cdf(1 - share) if share < 1 else -np.inf
    return np.asarray(smooth_field(rng, *shape, cell_px) > threshold)


def _bytes(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    count = int(np.prod(shape))
    words: NDArray[Any] = rng.integers(0, 2**64 - 1, -(-count // 8), dtype=np.uint64, endpoint=True)
    return words.astype("<u8", copy=False).view(np.uint8)[:count].reshape(shape)
