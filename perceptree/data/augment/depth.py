"""Simulated faults of a depth sensor on 8-bit depth images."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Bool, Float32, UInt8
from calib import DepthEncoding, encode_depth
from perceptree.data.augment.randomness import (
    add_levels,
    blobs,
    normal,
    normal_levels,
    uniform_symmetric,
    uniform_up_to,
)
from perceptree.settings.augmentation import DepthSettings

_REFERENCE_M = 10.0
_MIN_DEPTH_M = 0.05
_EDGE_SHARE = 0.06
_EDGE_LEVELS = 3
_OCCLUSION_TOLERANCE_PX = 1.5
_MIN_READ_SHARE = 0.1
_MIN_HOLE_PX, _MAX_HOLE_PX = 2, 25


@lru_cache(maxsize=8)
def level_metres(encoding: DepthEncoding) -> Float32:
    """Return the depth of each grey level.

    Returns:
        (256,) float32 metres, at least 0.05; infinite for no reading. Read-only.
    """
    share = (np.arange(256) - encoding.near_value) / (encoding.far_value - encoding.near_value)
    metres = encoding.near_m + share * (encoding.far_m - encoding.near_m)
    found = np.maximum(metres, _MIN_DEPTH_M).astype(np.float32)
    found[encoding.invalid_value] = np.inf
    found.flags.writeable = False
    return found


def disturb_depth(
    rng: np.random.Generator, image: UInt8, encoding: DepthEncoding, settings: DepthSettings
) -> UInt8:
    """Apply all depth faults, in the order of the settings.

    Pixels without a reading stay without one.

    Args:
        rng: Source of the random numbers.
        image: (H, W) uint8 depth image.
        encoding: Encoding of the image.
        settings: Strengths of the faults.

    Returns:
        (H, W) uint8 depth image.
    """
    invalid, metres_of = encoding.invalid_value, level_metres(encoding)
    missing = (image == invalid).view(np.uint8)
    faulty = _disturb_readings(rng, image, encoding, settings)
    faulty = _quantise_and_limit(rng, faulty, encoding, settings)
    lost: list[Bool] = []
    if settings.stereo_px_m:
        stereo_px_m = np.float32(uniform_up_to(rng, settings.stereo_px_m))
        disparity = np.asarray(cv2.LUT(image, stereo_px_m / metres_of), np.float32)
        lost.append(hidden_from_right(disparity))
    if settings.edge_loss_px:
        lost.append(_edge_loss(rng, image, metres_of, int(rng.integers(settings.edge_loss_px + 1))))
    if settings.hole_area:
        share = uniform_up_to(rng, settings.hole_area)
        lost.append(blobs(rng, image.shape, share, float(rng.uniform(12, 80))))
    if faulty is image:
        faulty = image.copy()
    for gone in lost:
        faulty[gone] = invalid
    for _ in range(int(rng.integers(settings.holes + 1))):
        x, y = int(rng.integers(image.shape[1])), int(rng.integers(image.shape[0]))
        w, h = rng.integers(_MIN_HOLE_PX, _MAX_HOLE_PX + 1, 2)
        faulty[y : y + h, x : x + w] = invalid
    return np.asarray(cv2.copyTo(image, missing, faulty), np.uint8)


def _disturb_readings(
    rng: np.random.Generator, image: UInt8, encoding: DepthEncoding, settings: DepthSettings
) -> UInt8:
    """Apply the gain and both kinds of noise."""
    gain = 1 + uniform_symmetric(rng, settings.depth_gain)
    if gain != 1:
        image = _map_levels(image, level_metres(encoding) * np.float32(gain), encoding)
    deviation = uniform_up_to(rng, settings.depth_noise)
    if deviation:
        image = add_levels(image, normal_levels(rng, image.shape, deviation))
    deviation_m = uniform_up_to(rng, settings.far_noise_m)
    if deviation_m:
        per_m = (encoding.far_value - encoding.near_value) / (encoding.far_m - encoding.near_m)
        spread = abs(per_m) * deviation_m * (level_metres(encoding) / _REFERENCE_M) ** 2
        spread[encoding.invalid_value] = 0
        noise = normal(rng, image.shape)
        cv2.multiply(noise, cv2.LUT(image, spread), dst=noise)
        image = np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)
    return image


def _quantise_and_limit(
    rng: np.random.Generator, image: UInt8, encoding: DepthEncoding, settings: DepthSettings
) -> UInt8:
    """Quantise the readings evenly in disparity, and remove those beyond a maximum depth."""
    step_m = uniform_up_to(rng, settings.far_step_m)
    loss = uniform_up_to(rng, settings.range_loss)
    if not step_m and not loss:
        return image
    metres = level_metres(encoding).copy()
    if step_m:
        # Step of inverse depth in 1/m, from dz = z**2 d(1/z).
        step = np.float32(step_m / _REFERENCE_M**2)
        steps = np.maximum(np.rint(1 / metres / step), 0.5)
        metres = (1 / (steps * step)).astype(np.float32)
    metres[metres > encoding.far_m - loss * (encoding.far_m - encoding.near_m)] = np.inf
    return _map_levels(image, metres, encoding)


def _map_levels(image: UInt8, metres: Float32, encoding: DepthEncoding) -> UInt8:
    """Replace each grey level by that of a new depth; no reading stays no reading."""
    table = encode_depth(metres[None], encoding)[0]
    table[encoding.invalid_value] = encoding.invalid_value
    return np.asarray(cv2.LUT(image, table), np.uint8)


def hidden_from_right(disparity_px: Float32) -> Bool:
    """Return the (H, W) pixels of a stereo pair's left image that the right camera cannot see.

    A point at column x appears at x - f b / z in the right image. It is occluded by any point from
    further right in the left image that appears at its column or left of it.

    Args:
        disparity_px: (H, W) float32 f b / z; 0 where nothing is near.
    """
    right_px = np.arange(disparity_px.shape[1], dtype=np.float32) - disparity_px
    right_px = np.asarray(cv2.flip(right_px, 1), np.float32)
    limit_px = np.minimum.accumulate(right_px, axis=1) + np.float32(_OCCLUSION_TOLERANCE_PX)
    return np.asarray(cv2.flip(cv2.compare(right_px, limit_px, cv2.CMP_GT), 1) > 0)


def _edge_loss(rng: np.random.Generator, image: UInt8, metres_of: Float32, width_px: int) -> Bool:
    """Return (H, W) patches of a band along depth edges."""
    if not width_px:
        return np.zeros(image.shape, bool)
    finite = np.where(np.isfinite(metres_of), metres_of, 0)
    level_m = float(finite.max()) / 255
    # Compare readings only: missing ones are neither the maximum nor the minimum.
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


def trees_still_read(
    before: UInt8, after: UInt8, invalid: int, boxes: NDArray[Any], masks: Bool | None
) -> list[int]:
    """Return the indices of the trees that keep at least a tenth of their readings.

    Args:
        before: (H, W) depth image before the faults.
        after: (H, W) depth image with the faults.
        invalid: Grey value of no reading.
        boxes: (N, 4) x0, y0, x1, y1 in px.
        masks: (N, H, W) bool; if None, the boxes' areas are used.
    """
    read = before != invalid
    lost = (read & (after == invalid)).view(np.uint8)
    kept: list[int] = []
    for row, (x0, y0, x1, y1) in enumerate(boxes):
        part = (slice(math.floor(y0), math.ceil(y1)), slice(math.floor(x0), math.ceil(x1)))
        was, gone = read[part].view(np.uint8), lost[part]
        if masks is not None:
            was, gone = (area & masks[row][part] for area in (was, gone))
        if cv2.countNonZero(gone) <= (1 - _MIN_READ_SHARE) * cv2.countNonZero(was):
            kept.append(row)
    return kept
