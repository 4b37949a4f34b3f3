"""Noise fields and a smooth step function."""

from __future__ import annotations

import numpy as np

from perceptree.arrays import Float32


def spectral_noise(
    rng: np.random.Generator,
    shape: tuple[int, int],
    exponent: float,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Float32:
    """Draw a periodic random field with power spectrum ``1 / f ** exponent``.

    Args:
        rng: Source of random numbers.
        shape: Rows and columns.
        exponent: Exponent of the power spectrum; a larger one gives smoother fields.
        stretch: Factors of the frequencies along rows and columns, which make the field
            anisotropic.

    Returns:
        (H, W) float32 with zero mean and unit standard deviation.
    """
    height, width = shape
    rows = np.fft.fftfreq(height)[:, None] * height * stretch[0]
    columns = np.fft.rfftfreq(width)[None] * width * stretch[1]
    frequency = np.hypot(rows, columns)
    frequency[0, 0] = 1.0
    spectrum = np.fft.rfft2(rng.standard_normal(shape)) * frequency ** (-exponent / 2)
    spectrum[0, 0] = 0.0
    field = np.fft.irfft2(spectrum, shape)
    return np.asarray((field - field.mean()) / field.std(), np.float32)


def smoothstep(low: float, high: float, x: Float32) -> Float32:
    """Smooth step: 0 below ``low``, 1 above ``high``, a cubic in between."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t), np.float32)
