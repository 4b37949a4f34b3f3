"""Spatially correlated noise."""

from __future__ import annotations

import cv2
import numpy as np

from basetree.arrays import Float32


def smooth_noise(rng: np.random.Generator, shape: tuple[int, ...], sigma_px: float) -> Float32:
    """Draw white Gaussian noise, blurred by a Gaussian and scaled to unit variance.

    For a wide blur the noise is drawn on a coarser grid and interpolated linearly.

    Args:
        rng: Source of random numbers.
        shape: Rows and columns.
        sigma_px: Standard deviation of the blur, px. The autocorrelation is a Gaussian with a
            standard deviation of sqrt(2) `sigma_px`.

    Returns:
        (H, W) float32.
    """
    cell = max(1, int(sigma_px))
    sigma = sigma_px / cell
    rows, columns = (n // cell + 2 for n in shape)
    size = int(np.ceil(sigma * 4)) * 2 + 1
    coarse = rng.standard_normal((rows, columns), np.float32)
    coarse = np.asarray(cv2.GaussianBlur(coarse, (size, size), sigma), np.float32)
    coarse *= np.float32(1 / _variance_left(sigma, size, cell))
    if cell > 1:
        whole = (columns * cell, rows * cell)
        coarse = np.asarray(cv2.resize(coarse, whole, interpolation=cv2.INTER_LINEAR), np.float32)
    return np.ascontiguousarray(coarse[: shape[0], : shape[1]])


def _variance_left(sigma: float, size: int, cell: int) -> float:
    """Fraction of white noise's variance that a blur and linear interpolation keep, per axis."""
    weights = cv2.getGaussianKernel(size, sigma, cv2.CV_64F).ravel()
    alone, beside = weights @ weights, weights[1:] @ weights[:-1]
    if cell == 1:
        return float(alone)
    t = (np.arange(cell) + 0.5) / cell
    return float(np.mean(((1 - t) ** 2 + t**2) * alone + 2 * t * (1 - t) * beside))
