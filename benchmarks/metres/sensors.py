"""Faults of depth cameras."""

from __future__ import annotations

import cv2
import numpy as np

from basetree.arrays import Bool, Float32


def stereo_noise(
    depth_m: Float32, rng: np.random.Generator, per_m: float = 0.002, block_px: int = 4
) -> Float32:
    """Noise that grows with the squared distance and is the same in blocks of pixels."""
    height, width = depth_m.shape
    size = (height // block_px + 1, width // block_px + 1)
    coarse = rng.standard_normal(size)
    noise = coarse.repeat(block_px, 0).repeat(block_px, 1)[:height, :width]
    return np.where(depth_m > 0, depth_m + per_m * depth_m**2 * noise, 0.0).astype(np.float32)


def mean_filtered(depth_m: Float32, size_px: int) -> Float32:
    """The mean of the readings within a square; no reading where there was none."""
    valid = (depth_m > 0).astype(np.float32)
    box = (size_px, size_px)
    total = cv2.blur(depth_m, box) / np.maximum(cv2.blur(valid, box), 1e-6)
    return np.where(valid > 0, total, 0.0).astype(np.float32)


def bilateral_filtered(depth_m: Float32, size_px: int, range_m: float) -> Float32:
    """An edge-preserving filter."""
    smooth = cv2.bilateralFilter(depth_m, size_px, range_m, size_px / 2)
    return np.where(depth_m > 0, smooth, 0.0).astype(np.float32)


def shifted(depth_m: Float32, right_px: float, down_px: float = 0.0) -> Float32:
    """Depth that lies beside the picture, by the nearest pixel; none beyond its border."""
    move = np.array([[1, 0, right_px], [0, 1, down_px]], np.float32)
    return np.asarray(
        cv2.warpAffine(depth_m, move, depth_m.shape[::-1], flags=cv2.INTER_NEAREST), np.float32
    )


def without(depth_m: Float32, missing: Bool) -> Float32:
    """No reading where `missing` (H, W) says so."""
    return np.where(missing, 0.0, depth_m).astype(np.float32)
