"""Faults of a depth sensor, on pictures of depth in 8 bits."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib import DepthEncoding, encode_depth
from perceptree.data.augment.randomness import (
    add_levels,
    blobs,
    either_side,
    normal,
    normal_levels,
    strength,
)
from perceptree.data.augment.settings import DepthSettings

Bytes = NDArray[np.uint8]
Float32 = NDArray[np.float32]

_REFERENCE_M = 10.0
_NEAREST_M = 0.05
_EDGE_SHARE = 0.06
_EDGE_LEVELS = 3
_SHADOW_TOLERANCE_PX = 1.5
_LEAST_READINGS = 0.1
_LEAST_HOLE_PX, _LARGEST_HOLE_PX = 2, 25


@lru_cache(maxsize=8)
def level_metres(encoding: DepthEncoding) -> Float32:
    """(256,) metres of each level, at least 5 cm; infinite for no reading. Read only."""
    share = (np.arange(256) - encoding.near_value) / (encoding.far_value - encoding.near_value)
    metres = encoding.near_m + share * (encoding.far_m - encoding.near_m)
    found = np.maximum(metres, _NEAREST_M).astype(np.float32)
    found[encoding.invalid_value] = np.inf
    found.flags.writeable = False
    return found


def disturb_depth(
    rng: np.random.Generator, image: Bytes, encoding: DepthEncoding, settings: DepthSettings
) -> Bytes:
    """All of the settings' faults on a (H, W) picture, in their order.

    What is no reading stays none.
    """
    invalid, metres_of = encoding.invalid_value, level_metres(encoding)
    unread = (image == invalid).view(np.uint8)
    faulty = _disturb_readings(rng, image, encoding, settings)
    faulty = _lose_range(rng, faulty, encoding, settings)
    lost: list[NDArray[np.bool_]] = []
    if settings.stereo_px_m:
        lost.append(_shadows(image, metres_of, strength(rng, settings.stereo_px_m)))
    if settings.edge_loss_px:
        lost.append(_edges(rng, image, metres_of, int(rng.integers(settings.edge_loss_px + 1))))
    if settings.hole_area:
        share = strength(rng, settings.hole_area)
        lost.append(blobs(rng, image.shape, share, float(rng.uniform(12, 80))))
    if faulty is image:
        faulty = image.copy()
    for gone in lost:
        faulty[gone] = invalid
    for _ in range(int(rng.integers(settings.holes + 1))):
        x, y = int(rng.integers(image.shape[1])), int(rng.integers(image.shape[0]))
        w, h = rng.integers(_LEAST_HOLE_PX, _LARGEST_HOLE_PX + 1, 2)
        faulty[y : y + h, x : x + w] = invalid
    return np.asarray(cv2.copyTo(image, unread, faulty), np.uint8)


def _disturb_readings(
    rng: np.random.Generator, image: Bytes, encoding: DepthEncoding, settings: DepthSettings
) -> Bytes:
    """Gain, and both kinds of noise."""
    gain = 1 + either_side(rng, settings.depth_gain)
    if gain != 1:
        image = _through(image, level_metres(encoding) * np.float32(gain), encoding)
    deviation = strength(rng, settings.depth_noise)
    if deviation:
        image = add_levels(image, normal_levels(rng, image.shape, deviation))
    deviation_m = strength(rng, settings.far_noise_m)
    if deviation_m:
        per_m = (encoding.far_value - encoding.near_value) / (encoding.far_m - encoding.near_m)
        spread = abs(per_m) * deviation_m * (level_metres(encoding) / _REFERENCE_M) ** 2
        spread[encoding.invalid_value] = 0
        noise = normal(rng, image.shape)
        cv2.multiply(noise, cv2.LUT(image, spread), dst=noise)
        image = np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)
    return image


def _lose_range(
    rng: np.random.Generator, image: Bytes, encoding: DepthEncoding, settings: DepthSettings
) -> Bytes:
    """Steps that are even in disparity, and an end of the range."""
    step_m = strength(rng, settings.far_step_m)
    loss = strength(rng, settings.range_loss)
    if not step_m and not loss:
        return image
    metres = level_metres(encoding).copy()
    if step_m:
        # A step of disparity, in 1/m: dz = z**2 d(1/z).
        step = np.float32(step_m / _REFERENCE_M**2)
        steps = np.maximum(np.rint(1 / metres / step), 0.5)
        metres = (1 / (steps * step)).astype(np.float32)
    metres[metres > encoding.far_m - loss * (encoding.far_m - encoding.near_m)] = np.inf
    return _through(image, metres, encoding)


def _through(image: Bytes, metres: Float32, encoding: DepthEncoding) -> Bytes:
    """Each level replaced by that of new metres; no reading stays none."""
    table = encode_depth(metres[None], encoding)[0]
    table[encoding.invalid_value] = encoding.invalid_value
    return np.asarray(cv2.LUT(image, table), np.uint8)


def _shadows(image: Bytes, metres_of: Float32, stereo_px_m: float) -> NDArray[np.bool_]:
    """(H, W) what the right camera of a stereo pair does not see of the left one's picture.

    A point at column x comes to lie at x - f b / z there. It is hidden by any point from further
    right that comes to lie at its place or left of it.
    """
    seen_at = np.asarray(cv2.LUT(image, -np.float32(stereo_px_m) / metres_of), np.float32)
    seen_at += np.arange(image.shape[1], dtype=np.float32)
    seen_at = np.asarray(cv2.flip(seen_at, 1), np.float32)
    hider, tolerance = np.minimum.accumulate(seen_at, axis=1), np.float32(_SHADOW_TOLERANCE_PX)
    return np.asarray(cv2.flip(cv2.compare(seen_at, hider + tolerance, cv2.CMP_GT), 1) > 0)


def _edges(
    rng: np.random.Generator, image: Bytes, metres_of: Float32, width_px: int
) -> NDArray[np.bool_]:
    """(H, W) a band along steps in depth, in patches."""
    if not width_px:
        return np.zeros(image.shape, bool)
    finite = np.where(np.isfinite(metres_of), metres_of, 0)
    level_m = float(finite.max()) / 255
    # Steps between readings: what is none is neither the highest nor the lowest of its neighbours.
    lowest, highest = np.arange(256, dtype=np.uint8), np.arange(256, dtype=np.uint8)
    lowest[~np.isfinite(metres_of)], highest[~np.isfinite(metres_of)] = 255, 0
    around = np.ones((3, 3), np.uint8)
    step = cv2.subtract(
        cv2.dilate(cv2.LUT(image, highest), around), cv2.erode(cv2.LUT(image, lowest), around)
    )
    least = np.rint(_EDGE_LEVELS + _EDGE_SHARE * finite / level_m).clip(0, 255).astype(np.uint8)
    edges = cv2.compare(step, cv2.LUT(image, least), cv2.CMP_GT)
    side = 2 * width_px - 1
    band = cv2.dilate(edges, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    patches = blobs(rng, image.shape, float(rng.uniform(0.3, 1)), 24.0)
    return np.asarray((band > 0) & patches)


def still_read(
    before: Bytes, after: Bytes, invalid: int, boxes: NDArray[Any], masks: NDArray[np.bool_] | None
) -> list[int]:
    """Which trees keep at least a tenth of their readings: of their masks, or else their boxes."""
    read = before != invalid
    lost = (read & (after == invalid)).view(np.uint8)
    kept: list[int] = []
    for row, (x0, y0, x1, y1) in enumerate(boxes):
        part = (slice(math.floor(y0), math.ceil(y1)), slice(math.floor(x0), math.ceil(x1)))
        was, gone = read[part].view(np.uint8), lost[part]
        if masks is not None:
            was, gone = (area & masks[row][part] for area in (was, gone))
        if cv2.countNonZero(gone) <= (1 - _LEAST_READINGS) * cv2.countNonZero(was):
            kept.append(row)
    return kept
