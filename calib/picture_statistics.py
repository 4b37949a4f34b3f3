"""Simple statistics of how a picture looks, and their usual ranges over many pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float64, UInt8
from calib.depth.encoding import DepthEncoding

_BLOWN, _BLACK = 250, 8
_BLOCK_PX, _EVERY = 8, 4
_FLAT = 1e-6
_USUAL: Final = (1.0, 99.0)
_DIGITS: Final = 3

DEPTH_STATISTICS: Final = ("reading_percent", "median_m", "spread_m", "top_bottom_m", "texture_m")
"""Names of the statistics of depth; the others are of colour."""


def picture_statistics(image: UInt8, encoding: DepthEncoding | None = None) -> dict[str, float]:
    """Compute the statistics of a picture.

    To take little time, every fourth band of 8 rows is looked at.

    Args:
        image: (H, W, 3) uint8 BGR, or (H, W) uint8 depth; without padding.
        encoding: How the depth is encoded; None for colour.

    Returns:
        Values by name. Of colour: `lightness`, `contrast`, `saturation`, `green_red`,
        `blue_yellow` and `top_bottom` in grey levels, `blown_percent` and `black_percent`,
        `texture` (mean step between neighbouring pixels) and `local_contrast` (the median of
        blocks of 8x8 px), both as shares of the contrast, and `upright` (share of the steps that
        are from left to right). Of depth: `reading_percent` (pixels with a reading in range),
        `median_m`, `spread_m` (10th to 90th percentile), `top_bottom_m` and `texture_m`
        (mean step between neighbouring pixels). Those for which there are too few readings are
        left out.
    """
    return _of_colour(image) if encoding is None else _of_depth(image, encoding)


def usual_ranges(pictures: Iterable[Mapping[str, float]]) -> dict[str, tuple[float, float]]:
    """The 1st and 99th percentile of each statistic over pictures.

    Args:
        pictures: Results of `picture_statistics`.
    """
    values: dict[str, list[float]] = {}
    for statistics in pictures:
        for name, value in statistics.items():
            values.setdefault(name, []).append(value)
    return {name: _usual_range(found) for name, found in values.items()}


def _usual_range(values: list[float]) -> tuple[float, float]:
    low, high = np.percentile(values, _USUAL)
    return round(float(low), _DIGITS), round(float(high), _DIGITS)


def _of_colour(image: UInt8) -> dict[str, float]:
    bands = _bands(image)
    pixels = bands.reshape(-1, *bands.shape[2:])
    grey: Any = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    shares = _histogram(grey) / grey.size
    levels = np.arange(256)
    mean = float(levels @ shares)
    contrast = float(np.sqrt(max((levels - mean) ** 2 @ shares, 0.0)))
    blue, green, red = (float(value) for value in cv2.mean(pixels)[:3])
    across, down = _mean_step(grey[None], 2), _mean_step(grey.reshape(bands.shape[:3]), 1)
    third = max(1, len(grey) // 3)
    return {
        "lightness": mean,
        "contrast": contrast,
        "saturation": _saturation(pixels),
        "green_red": green - red,
        "blue_yellow": blue - (green + red) / 2,
        "top_bottom": cv2.mean(grey[:third])[0] - cv2.mean(grey[-third:])[0],
        "blown_percent": 100 * float(shares[_BLOWN + 1 :].sum()),
        "black_percent": 100 * float(shares[:_BLACK].sum()),
        "texture": (across + down) / 2 / max(contrast, 1.0),
        "local_contrast": _local_contrast(grey) / max(contrast, 1.0),
        "upright": across / max(across + down, _FLAT),
    }


def _of_depth(image: UInt8, encoding: DepthEncoding) -> dict[str, float]:
    pixels = _bands(image).reshape(-1, image.shape[1])
    used = np.ones(256, bool)
    used[[encoding.invalid_value, encoding.far_value]] = False
    m_per_level = (encoding.far_m - encoding.near_m) / (encoding.far_value - encoding.near_value)
    levels_m = encoding.near_m + m_per_level * (np.arange(256) - encoding.near_value)
    third = max(1, len(pixels) // 3)
    whole, top, bottom = (
        np.where(used, _histogram(part), 0) for part in (pixels, pixels[:third], pixels[-third:])
    )
    found = {"reading_percent": 100 * float(whole.sum()) / pixels.size}
    if whole.any():
        low, median, high = (_percentile(levels_m, whole, share) for share in (0.1, 0.5, 0.9))
        found |= {"median_m": median, "spread_m": abs(high - low)}
    if top.any() and bottom.any():
        found["top_bottom_m"] = _percentile(levels_m, top, 0.5) - _percentile(levels_m, bottom, 0.5)
    inside = used[pixels]
    both = inside[:, 1:] & inside[:, :-1]
    if both.any():
        steps = cv2.absdiff(pixels[:, 1:], pixels[:, :-1])
        found["texture_m"] = abs(m_per_level) * float(steps[both].mean())
    return found


def _bands(image: UInt8) -> UInt8:
    """Every fourth band of 8 rows, (bands, rows, W) or with colour; all rows of a low image."""
    count = len(image) // (_EVERY * _BLOCK_PX)
    if not count:
        return image[None]
    rows = image[: count * _EVERY * _BLOCK_PX]
    bands = rows.reshape(count, _EVERY * _BLOCK_PX, *image.shape[1:])[:, :_BLOCK_PX]
    return np.ascontiguousarray(bands)


def _histogram(grey: UInt8) -> Float64:
    """Number of pixels of each grey level, (256,)."""
    counts = cv2.calcHist([grey], [0], None, [256], [0, 256])
    return np.asarray(counts, np.float64).ravel()


def _percentile(levels: NDArray[Any], counts: Float64, share: float) -> float:
    """The level that `share` of the pixels do not exceed, in the order of the histogram."""
    total = np.cumsum(counts)
    return float(levels[np.searchsorted(total, share * total[-1])])


def _saturation(image: UInt8) -> float:
    """Mean difference of the highest and the lowest channel of a pixel, grey levels."""
    blue, green, red = cv2.split(image)
    highest = cv2.max(cv2.max(blue, green), red)
    lowest = cv2.min(cv2.min(blue, green), red)
    return float(cv2.mean(cv2.subtract(highest, lowest))[0])


def _local_contrast(grey: Any) -> float:
    """Median standard deviation of the blocks, grey levels."""
    height, width = grey.shape
    size = (max(1, width // _BLOCK_PX), max(1, height // _BLOCK_PX))
    levels = grey.astype(np.float32)
    mean = cv2.resize(levels, size, interpolation=cv2.INTER_AREA)
    square = cv2.resize(levels * levels, size, interpolation=cv2.INTER_AREA)
    return float(np.median(np.sqrt(np.maximum(square - mean * mean, 0))))


def _mean_step(grey: Any, axis: int) -> float:
    """Mean absolute difference of neighbours along axis 1 or 2 of (bands, rows, W), grey levels."""
    if grey.shape[axis] < 2:
        return 0.0
    one, other = (grey[:, 1:], grey[:, :-1]) if axis == 1 else (grey[..., 1:], grey[..., :-1])
    width = one.shape[-1]
    return float(cv2.mean(cv2.absdiff(one.reshape(-1, width), other.reshape(-1, width)))[0])
