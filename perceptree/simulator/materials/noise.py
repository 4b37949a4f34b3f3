"""Periodic noise fields and cellular patterns (Worley 1996), and a smooth step function."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, Float32
from perceptree.simulator.materials.layers import SIZE_PX

_WARP = 0.22


def spectral_noise(
    rng: np.random.Generator,
    shape: tuple[int, int],
    exponent: float,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Float32:
    """Draw a periodic random field with power spectrum `1 / f ** exponent`.

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


def jittered_cells(
    rng: np.random.Generator, cells: tuple[int, int], warp_across: Float, warp_along: Float
) -> tuple[Float, NDArray[np.intp]]:
    """Compute a cellular pattern: one cell around each of a grid of jittered points.

    Args:
        rng: Source of random numbers.
        cells: Number of cells along columns and rows.
        warp_across: (SIZE, SIZE) noise of about unit deviation that bends the borders in x.
        warp_along: (SIZE, SIZE) noise that bends the borders in y.

    Returns:
        (SIZE, SIZE) distance to the nearest second point minus that to the nearest one, in cells,
        which is 0 on borders; and (SIZE, SIZE) number of the cell.
    """
    columns, rows = cells
    position = np.arange(SIZE_PX, dtype=np.float32) / SIZE_PX
    x = position * columns + np.float32(_WARP) * warp_across.astype(np.float32)
    y = (position * rows)[:, None] + np.float32(_WARP) * warp_along.astype(np.float32)
    column, row = np.floor(x).astype(np.int32), np.floor(y).astype(np.int32)
    jitter = rng.uniform(0.08, 0.92, (2, rows, columns)).astype(np.float32)
    number = np.arange(rows * columns, dtype=np.intp).reshape(rows, columns)
    nearest = np.full((SIZE_PX, SIZE_PX), 9.0, np.float32)
    second, cell = nearest.copy(), np.zeros((SIZE_PX, SIZE_PX), np.intp)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            at = (row + down) % rows, (column + right) % columns
            dx = column + right + jitter[0][at] - x
            dy = row + down + jitter[1][at] - y
            distance = dx * dx + dy * dy
            closer = distance < nearest
            second = np.where(closer, nearest, np.minimum(second, distance))
            cell = np.where(closer, number[at], cell)
            nearest = np.where(closer, distance, nearest)
    return np.sqrt(second) - np.sqrt(nearest), cell


def smoothstep(low: float, high: float, x: Float) -> Float32:
    """Smooth step: 0 below `low`, 1 above `high`, a cubic in between."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t), np.float32)
