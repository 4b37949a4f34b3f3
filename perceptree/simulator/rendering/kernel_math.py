"""Numba functions for the kernels: noise, smooth steps and texture sampling."""

from __future__ import annotations

import numpy as np
from numba import njit

from perceptree.simulator.materials.layers import FIRST_CUTOUT, FIRST_OBJECT, SIZE_PX

_f32 = np.float32
_AREA = np.float32(SIZE_PX * SIZE_PX)
_FIRST_CUTOUT, _FIRST_OBJECT = int(FIRST_CUTOUT), int(FIRST_OBJECT)


@njit(inline="always", cache=True, error_model="numpy")
def hashed(x, y):
    """Hash two integers to a number in [0, 1)."""
    n = (x * 374761393 + y * 668265263) & 0xFFFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0xFFFFFFFF
    return _f32((n ^ (n >> 16)) & 0xFFFF) * _f32(1 / 65536)


@njit(inline="always", cache=True, error_model="numpy")
def value_noise(x, y):
    """Value noise in [0, 1): interpolates one random value per integer grid point."""
    column, row = int(np.floor(x)), int(np.floor(y))
    u, v = _f32(x - np.floor(x)), _f32(y - np.floor(y))
    u, v = u * u * (_f32(3) - _f32(2) * u), v * v * (_f32(3) - _f32(2) * v)
    a, b = hashed(column, row), hashed(column + 1, row)
    c, d = hashed(column, row + 1), hashed(column + 1, row + 1)
    return a + (b - a) * u + (c - a + (a - b - c + d) * u) * v


@njit(inline="always", cache=True, error_model="numpy")
def cloud(x, y):
    """Value noise of two octaves in [0, 1)."""
    return _f32(0.65) * value_noise(x, y) + _f32(0.35) * value_noise(
        x * _f32(2.7) + _f32(7), y * _f32(2.7) + _f32(3)
    )


@njit(inline="always", cache=True, error_model="numpy")
def ramp(low, high, x):
    """Smooth step: 0 below `low`, 1 above `high`, a cubic in between."""
    t = min(max((x - low) / (high - low), _f32(0)), _f32(1))
    return t * t * (_f32(3) - _f32(2) * t)


@njit(inline="always", cache=True, error_model="numpy")
def luminance(colour):
    """Approximate luminance of a linear RGB colour."""
    return _f32(0.3) * colour[0] + _f32(0.6) * colour[1] + _f32(0.1) * colour[2]


@njit(inline="always", cache=True, error_model="numpy")
def normalise(vector):
    """Normalise a vector (3,) in place."""
    length = np.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    scale = _f32(1) / (length + _f32(1e-9))
    for axis in range(3):
        vector[axis] *= scale


@njit(inline="always", cache=True, error_model="numpy")
def is_cutout(texture):
    """Whether a layer is cut out by its alpha."""
    return _FIRST_CUTOUT <= texture < _FIRST_OBJECT


@njit(inline="always", cache=True, error_model="numpy")
def face_texels(corners, u, i, j, k):
    """Twice the area of a face in texels of the finest mip level.

    `corners` (V, n) holds the texture coordinates of the vertices in the columns u and u + 1.
    """
    return _AREA * abs(
        (corners[j, u] - corners[i, u]) * (corners[k, u + 1] - corners[i, u + 1])
        - (corners[k, u] - corners[i, u]) * (corners[j, u + 1] - corners[i, u + 1])
    )


@njit(inline="always", cache=True, error_model="numpy")
def mip_level(texels, most, last):
    """The first mip level with at most `most` texels in an area, or the last one."""
    level = 0
    while texels > most and level < last:
        texels *= _f32(0.25)
        level += 1
    return level


@njit(inline="always", cache=True, error_model="numpy")
def sample(table, offsets, texture, level, u, v, out):
    """Sample a repeating texture bilinearly.

    Args:
        table: (N, C) uint8, all textures and mip levels.
        offsets: (levels,) first texel of each mip level.
        texture: Number of the texture.
        level: Mip level.
        u: Horizontal texture coordinate, in repeats.
        v: Vertical texture coordinate, in repeats.
        out: (3,) float32, receives the first three channels, 0 to 1.
    """
    size = SIZE_PX >> level
    mask = size - 1
    x, y = u * size - _f32(0.5), v * size - _f32(0.5)
    floor_x, floor_y = np.floor(x), np.floor(y)
    right, down = _f32(x - floor_x), _f32(y - floor_y)
    column, row = int(floor_x), int(floor_y)
    base = offsets[level] + texture * size * size
    upper, lower = base + (row & mask) * size, base + ((row + 1) & mask) * size
    first, second = column & mask, (column + 1) & mask
    scale = _f32(1 / 255)
    wa, wb = (_f32(1) - right) * (_f32(1) - down) * scale, right * (_f32(1) - down) * scale
    wc, wd = (_f32(1) - right) * down * scale, right * down * scale
    for c in range(3):
        out[c] = (
            table[upper + first, c] * wa
            + table[upper + second, c] * wb
            + table[lower + first, c] * wc
            + table[lower + second, c] * wd
        )


@njit(inline="always", cache=True, error_model="numpy")
def nearest(table, offsets, texture, level, u, v, out):
    """Sample the nearest texel of a repeating texture, with arguments as for `sample`."""
    size = SIZE_PX >> level
    mask = size - 1
    column, row = int(np.floor(u * size)) & mask, int(np.floor(v * size)) & mask
    texel = offsets[level] + texture * size * size + row * size + column
    for c in range(3):
        out[c] = table[texel, c] * _f32(1 / 255)
