"""Numba helpers of the shading kernels: noise in world space, ramps and texture samples."""

from __future__ import annotations

import numpy as np
from numba import njit

from perceptree.simulator.materials.layers import SIZE_PX

_f = np.float32


@njit(inline="always", cache=True, error_model="numpy")
def hashed(x, y):
    """A number in [0, 1) for two whole numbers."""
    n = (x * 374761393 + y * 668265263) & 0xFFFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0xFFFFFFFF
    return _f((n ^ (n >> 16)) & 0xFFFF) * _f(1 / 65536)


@njit(inline="always", cache=True, error_model="numpy")
def value_noise(x, y):
    """Smooth noise in [0, 1) with one value per unit square."""
    column, row = int(np.floor(x)), int(np.floor(y))
    u, v = _f(x - np.floor(x)), _f(y - np.floor(y))
    u, v = u * u * (_f(3) - _f(2) * u), v * v * (_f(3) - _f(2) * v)
    a, b = hashed(column, row), hashed(column + 1, row)
    c, d = hashed(column, row + 1), hashed(column + 1, row + 1)
    return a + (b - a) * u + (c - a + (a - b - c + d) * u) * v


@njit(inline="always", cache=True, error_model="numpy")
def cloud(x, y):
    """Noise in [0, 1) of two octaves."""
    return _f(0.65) * value_noise(x, y) + _f(0.35) * value_noise(
        x * _f(2.7) + _f(7), y * _f(2.7) + _f(3)
    )


@njit(inline="always", cache=True, error_model="numpy")
def ramp(low, high, x):
    """0 below ``low``, 1 above ``high``, a smooth cubic between."""
    t = min(max((x - low) / (high - low), _f(0)), _f(1))
    return t * t * (_f(3) - _f(2) * t)


@njit(inline="always", cache=True, error_model="numpy")
def luminance(colour):
    """Brightness of a linear RGB colour."""
    return _f(0.3) * colour[0] + _f(0.6) * colour[1] + _f(0.1) * colour[2]


@njit(inline="always", cache=True, error_model="numpy")
def normalise(vector):
    """Scale a vector to length one, in place."""
    length = np.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    scale = _f(1) / (length + _f(1e-9))
    for axis in range(3):
        vector[axis] *= scale


@njit(inline="always", cache=True, error_model="numpy")
def sample(table, offsets, texture, level, u, v, out):
    """Bilinear sample of the first three channels into ``out``, 0 to 1, the texture repeating."""
    size = SIZE_PX >> level
    mask = size - 1
    x, y = u * size - _f(0.5), v * size - _f(0.5)
    floor_x, floor_y = np.floor(x), np.floor(y)
    right, down = _f(x - floor_x), _f(y - floor_y)
    column, row = int(floor_x), int(floor_y)
    base = offsets[level] + texture * size * size
    upper, lower = base + (row & mask) * size, base + ((row + 1) & mask) * size
    first, second = column & mask, (column + 1) & mask
    scale = _f(1 / 255)
    wa, wb = (_f(1) - right) * (_f(1) - down) * scale, right * (_f(1) - down) * scale
    wc, wd = (_f(1) - right) * down * scale, right * down * scale
    for c in range(3):
        out[c] = (
            table[upper + first, c] * wa
            + table[upper + second, c] * wb
            + table[lower + first, c] * wc
            + table[lower + second, c] * wd
        )


@njit(inline="always", cache=True, error_model="numpy")
def nearest(table, offsets, texture, level, u, v, out):
    """Nearest sample of the first three channels into ``out``, 0 to 1: enough for foliage."""
    size = SIZE_PX >> level
    mask = size - 1
    column, row = int(np.floor(u * size)) & mask, int(np.floor(v * size)) & mask
    place = offsets[level] + texture * size * size + row * size + column
    for c in range(3):
        out[c] = table[place, c] * _f(1 / 255)
