"""Numba kernels from visible triangles to colour: materials, shadow, ambient light, haze."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from perceptree.simulator.rasterise import FIRST_CUTOUT, LAST_CUTOUT, uv_area
from perceptree.simulator.textures import MIP_LEVELS, SIZE_PX, Layer

_Floats = NDArray[np.float32]
_f = np.float32
_SIZE = SIZE_PX
_LITTER, _MOSS = int(Layer.LITTER), int(Layer.MOSS)
_TAPS_X = np.array([0.3, -0.55, 0.1, 0.85, -0.9, 0.2], np.float32)
_TAPS_Y = np.array([0.1, 0.45, -0.75, 0.5, -0.4, 0.95], np.float32)


class Surface(NamedTuple):
    """What the kernel reads of the scene; vertex arrays as in ``Scene``, ``screen`` projected."""

    screen: _Floats
    faces: NDArray[np.int32]
    layer: NDArray[np.uint8]
    normals: _Floats
    uv: _Floats
    tint: _Floats
    sky: _Floats
    ground_z: np.float32


class Maps(NamedTuple):
    """Textures with their mip offsets, and the sun's shadow map with its (3, 4) matrix."""

    albedo: NDArray[np.uint8]
    relief: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    shadow: _Floats
    shadow_rows: _Floats
    shadow_bias: np.float32


class Eye(NamedTuple):
    """Camera of the samples: world origin (3,), rows right, down, forward (3, 3), focal px."""

    origin: _Floats
    rotation: _Floats
    focal: np.float32


class Illumination(NamedTuple):
    """Direction to the sun and linear RGB colours, (3,) each, and haze per metre."""

    sun: _Floats
    sun_colour: _Floats
    sky_colour: _Floats
    haze_colour: _Floats
    haze_per_m: np.float32


@njit(inline="always", cache=True)
def _hash(x, y):
    n = (x * 374761393 + y * 668265263) & 0xFFFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0xFFFFFFFF
    return _f((n ^ (n >> 16)) & 0xFFFF) * _f(1 / 65536)


@njit(inline="always", cache=True)
def _value_noise(x, y):
    column, row = int(np.floor(x)), int(np.floor(y))
    u, v = _f(x - np.floor(x)), _f(y - np.floor(y))
    u, v = u * u * (_f(3) - _f(2) * u), v * v * (_f(3) - _f(2) * v)
    a, b = _hash(column, row), _hash(column + 1, row)
    c, d = _hash(column, row + 1), _hash(column + 1, row + 1)
    return a + (b - a) * u + (c - a + (a - b - c + d) * u) * v


@njit(inline="always", cache=True)
def _cloud(x, y):
    return (
        _f(0.55) * _value_noise(x, y)
        + _f(0.3) * _value_noise(x * _f(2.3) + _f(7), y * _f(2.3) + _f(7))
        + _f(0.15) * _value_noise(x * _f(5.1) + _f(3), y * _f(5.1) + _f(3))
    )


@njit(inline="always", cache=True)
def _ramp(low, high, x):
    t = min(max((x - low) / (high - low), _f(0)), _f(1))
    return t * t * (_f(3) - _f(2) * t)


@njit(inline="always", cache=True)
def _texel(table, offsets, texture, level, u, v, channel):
    """Bilinear sample of one channel, 0 to 1, the texture repeating."""
    size = _SIZE >> level
    mask = size - 1
    x, y = u * size - _f(0.5), v * size - _f(0.5)
    column, row = int(np.floor(x)), int(np.floor(y))
    right, down = _f(x - column), _f(y - row)
    base = offsets[level] + texture * size * size
    upper, lower = base + (row & mask) * size, base + ((row + 1) & mask) * size
    first, second = column & mask, (column + 1) & mask
    above = table[upper + first, channel] * (_f(1) - right) + table[upper + second, channel] * right
    below = table[lower + first, channel] * (_f(1) - right) + table[lower + second, channel] * right
    return (above * (_f(1) - down) + below * down) * _f(1 / 255)


@njit(inline="always", cache=True)
def _ground(colour, normal, point, u, v, maps, level):
    """Blend litter and moss by noise in world space."""
    normal[0] += (_texel(maps.relief, maps.offsets, _LITTER, level, u, v, 0) * _f(2) - _f(1)) * _f(
        0.9
    )
    normal[1] -= (_texel(maps.relief, maps.offsets, _LITTER, level, u, v, 1) * _f(2) - _f(1)) * _f(
        0.9
    )
    patch = _cloud(point[0] * _f(0.55), point[1] * _f(0.55))
    patch += _f(0.35) * _cloud(point[0] * _f(3), point[1] * _f(3))
    share = _ramp(_f(0.6), _f(0.76), patch)
    shade = _f(0.7) + _f(0.6) * _value_noise(point[0] * _f(0.3) + _f(9), point[1] * _f(0.3))
    for c in range(3):
        moss = _texel(
            maps.albedo, maps.offsets, _MOSS, level, point[0] * _f(0.75), point[1] * _f(0.75), c
        )
        colour[c] = (colour[c] + (moss * moss - colour[c]) * share) * shade


@njit(inline="always", cache=True)
def _bark(colour, normal, point, foot_z, u, v, texture, maps, level):
    """Bark relief along the stem, blotches, and moss towards the foot."""
    across = _f(1) / np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + _f(1e-6))
    relief_x = _texel(maps.relief, maps.offsets, texture, level, u, v, 0) * _f(2) - _f(1)
    relief_y = _texel(maps.relief, maps.offsets, texture, level, u, v, 1) * _f(2) - _f(1)
    east, north = -normal[1] * across, normal[0] * across
    normal[0] += _f(1.3) * relief_x * east
    normal[1] += _f(1.3) * relief_x * north
    normal[2] += _f(1.3) * relief_y
    turn = _f(np.arctan2(normal[1], normal[0]))
    blotch = _f(0.75) + _f(0.5) * _value_noise(turn * _f(3), point[2] * _f(3))
    low = _ramp(_f(-1.2), _f(0.6), foot_z + _f(0.3) - point[2])
    patch = _cloud(point[0] * _f(2) + point[2], point[1] * _f(2) + point[2] * _f(1.7))
    moss = _ramp(_f(0.5), _f(0.75), patch) * low * _f(0.8)
    colour[0] = colour[0] * blotch + (_f(0.06) - colour[0] * blotch) * moss
    colour[1] = colour[1] * blotch + (_f(0.085) - colour[1] * blotch) * moss
    colour[2] = colour[2] * blotch + (_f(0.02) - colour[2] * blotch) * moss


@njit(inline="always", cache=True)
def _normalise(vector):
    length = np.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    for axis in range(3):
        vector[axis] /= length + _f(1e-9)


@njit(cache=True)
def _sunlit(point, normal, sun, maps, turn):
    """Share of the sun that reaches a point, from six taps of the shadow map."""
    size = maps.shadow.shape[0]
    rows = maps.shadow_rows
    column, row, nearness = rows[0, 3], rows[1, 3], rows[2, 3]
    for axis in range(3):
        place = point[axis] + normal[axis] * _f(0.03) + sun[axis] * _f(0.04)
        column += rows[0, axis] * place
        row += rows[1, axis] * place
        nearness += rows[2, axis] * place
    share = _f(0)
    for tap in range(6):
        x = int(column + (turn[0] * _TAPS_X[tap] - turn[1] * _TAPS_Y[tap]) * _f(2.2))
        y = int(row + (turn[1] * _TAPS_X[tap] + turn[0] * _TAPS_Y[tap]) * _f(2.2))
        outside = x < 0 or y < 0 or x >= size or y >= size
        if outside or maps.shadow[y, x] <= nearness + maps.shadow_bias:
            share += _f(1 / 6)
    return share


@njit(cache=True)
def _occlusion(near, x, y, ray, z, normal, eye, turn):
    """Screen-space ambient occlusion: how much nearby surfaces close off the hemisphere."""
    height, width = near.shape
    radius = _f(0.33) * eye.focal / max(z, _f(1))
    closed = _f(0)
    for tap in range(6):
        column = int(x + (turn[0] * _TAPS_X[tap] - turn[1] * _TAPS_Y[tap]) * radius)
        row = int(y + (turn[1] * _TAPS_X[tap] + turn[0] * _TAPS_Y[tap]) * radius)
        if column < 0 or row < 0 or column >= width or row >= height or near[row, column] <= 0:
            continue
        depth = _f(1) / near[row, column]
        right = (column + _f(0.5) - width * _f(0.5)) / eye.focal * depth - ray[0] * z
        down = (row + _f(0.5) - height * _f(0.5)) / eye.focal * depth - ray[1] * z
        away = depth - z
        squared = right * right + down * down + away * away
        facing = _f(0)
        for axis in range(3):
            facing += normal[axis] * (
                eye.rotation[0, axis] * right
                + eye.rotation[1, axis] * down
                + eye.rotation[2, axis] * away
            )
        facing = facing / (np.sqrt(squared) + _f(1e-3)) - _f(0.08)
        closed += max(facing, _f(0)) / (_f(1) + _f(3) * squared)
    return max(_f(0), _f(1) - closed * _f(0.42))


@njit(cache=True)
def _sky(colour, rise, towards_sun, light):
    """Sky from a bright horizon to the zenith, with a glow around the sun."""
    share = _ramp(_f(0), _f(0.55), max(rise, _f(0)))
    for c in range(3):
        horizon = max(light.haze_colour[c], light.sky_colour[c] * _f(0.8)) * _f(1.1)
        tone = horizon + (light.sky_colour[c] * _f(1.5) - horizon) * share
        colour[c] = tone * _f(1.3) + light.sun_colour[c] * _f(0.1) * towards_sun**8


@njit(cache=True)
def _weights(screen, i, j, k, x, y, z):
    """Perspective-correct weights of a face's corners at a sample, and its screen density."""
    x0, y0, x1, y1 = screen[i, 0], screen[i, 1], screen[j, 0], screen[j, 1]
    x2, y2 = screen[k, 0], screen[k, 1]
    inverse = _f(1) / ((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
    px, py = x + _f(0.5) - x2, y + _f(0.5) - y2
    a = (px * (y1 - y2) + py * (x2 - x1)) * inverse
    b = (px * (y2 - y0) + py * (x0 - x2)) * inverse
    c = _f(1) - a - b
    return a * screen[i, 2] * z, b * screen[j, 2] * z, c * screen[k, 2] * z, abs(inverse)


@njit(cache=True)
def _material(colour, normal, point, world, t, x, y, z, surface, maps):
    """Albedo and normal at a sample; returns the share of open sky and whether it is foliage."""
    i, j, k = surface.faces[t, 0], surface.faces[t, 1], surface.faces[t, 2]
    a, b, c, density = _weights(surface.screen, i, j, k, x, y, z)
    for axis in range(3):
        normal[axis] = (
            a * surface.normals[i, axis] + b * surface.normals[j, axis]
            + c * surface.normals[k, axis]
        )  # fmt: skip
    u = a * surface.uv[i, 0] + b * surface.uv[j, 0] + c * surface.uv[k, 0]
    v = a * surface.uv[i, 1] + b * surface.uv[j, 1] + c * surface.uv[k, 1]
    tint = a * surface.tint[i] + b * surface.tint[j] + c * surface.tint[k]
    level, ratio = 0, uv_area(surface.uv, i, j, k) * density
    while ratio > _f(0.6) and level < MIP_LEVELS - 1:
        ratio *= _f(0.25)
        level += 1
    texture = int(surface.layer[t])
    for channel in range(3):
        root = _texel(maps.albedo, maps.offsets, texture, level, u, v, channel)
        colour[channel] = root * root * tint
    _normalise(normal)
    foliage = FIRST_CUTOUT <= texture <= LAST_CUTOUT
    if foliage:
        if normal[0] * world[0] + normal[1] * world[1] + normal[2] * world[2] > 0:
            for axis in range(3):
                normal[axis] *= _f(0.3)
    elif texture == _LITTER:
        _ground(colour, normal, point, u, v, maps, level)
    else:
        _bark(colour, normal, point, surface.ground_z, u, v, texture, maps, level)
    if not foliage:
        _normalise(normal)
    return a * surface.sky[i] + b * surface.sky[j] + c * surface.sky[k], foliage


@njit(cache=True)
def _illuminate(colour, normal, lit, ambient, towards_sun, path_m, foliage, light):
    """Sun, sky and bounced light on a surface, then haze along the path to it."""
    sun = light.sun
    facing = normal[0] * sun[0] + normal[1] * sun[1] + normal[2] * sun[2]
    direct = max(facing, _f(0))
    if foliage:
        wrapped = max(facing * _f(0.6) + _f(0.4), _f(0)) * _f(0.65)
        through = max(-facing, _f(0)) * _f(0.35) + _f(0.25) * towards_sun**4
        direct = wrapped + through
    direct *= lit
    upward = normal[2] * _f(0.5) + _f(0.5)
    sky_level = (light.sky_colour[0] + light.sky_colour[1] + light.sky_colour[2]) * _f(1 / 3)
    for c in range(3):
        bounce = (_f(0.28) - _f(0.02) * c * (c + _f(1.2))) * sky_level
        around = bounce + (light.sky_colour[c] - bounce) * upward
        colour[c] *= light.sun_colour[c] * direct + around * ambient
    grey = _luminance(colour)
    clear = np.exp(-path_m * light.haze_per_m)
    glow = _f(1) + _f(0.5) * towards_sun**6
    for c in range(3):
        muted = colour[c] + (grey - colour[c]) * _f(0.2)
        colour[c] = light.haze_colour[c] * glow * (_f(1) - clear) + muted * clear


@njit(inline="always", cache=True)
def _luminance(colour):
    return _f(0.3) * colour[0] + _f(0.6) * colour[1] + _f(0.1) * colour[2]


@njit(cache=True)
def _shaded_neighbour(seen, x, y):
    """Column and row of a sample of the same face shaded before in this 2x2 block, or -1."""
    t = seen[y, x]
    if (x & 1) == 1 and seen[y, x - 1] == t:
        return x - 1, y
    if (y & 1) == 1 and seen[y - 1, x] == t:
        return x, y - 1
    if (y & 1) == 1 and seen[y - 1, x ^ 1] == t:
        return x ^ 1, y - 1
    return -1, -1


@njit(cache=True)
def _shade_sample(x, y, near, seen, surface, maps, eye, light, scratch):
    """Colour of one sample into ``scratch[0]``; the other rows are work space."""
    colour, ray, world, point, normal = scratch
    height, width = near.shape
    ray[0] = (x + _f(0.5) - width * _f(0.5)) / eye.focal
    ray[1] = (y + _f(0.5) - height * _f(0.5)) / eye.focal
    length = np.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + _f(1))
    towards_sun = _f(0)
    for axis in range(3):
        across = eye.rotation[0, axis] * ray[0] + eye.rotation[1, axis] * ray[1]
        world[axis] = across + eye.rotation[2, axis]
        towards_sun += world[axis] * light.sun[axis]
    towards_sun = max(towards_sun / length, _f(0))
    t = seen[y, x]
    if t < 0:
        _sky(colour, world[2] / length, towards_sun, light)
        return
    z = _f(1) / near[y, x]
    for axis in range(3):
        point[axis] = eye.origin[axis] + world[axis] * z
    open_sky, foliage = _material(colour, normal, point, world, t, x, y, z, surface, maps)
    grain = _f(52.9829189) * ((_f(0.06711056) * x + _f(0.00583715) * y) % _f(1))
    angle = (grain % _f(1)) * _f(6.2831)
    turn = (np.cos(angle), np.sin(angle))
    lit = _sunlit(point, normal, light.sun, maps, turn)
    ambient = open_sky * _occlusion(near, x, y, ray, z, normal, eye, turn)
    _illuminate(colour, normal, lit, ambient, towards_sun, z * length, foliage, light)


@njit(parallel=True, cache=True, error_model="numpy")
def shade_samples(near, seen, surface, maps, eye, light, out, log_sum):
    """Light every sample; ``out`` (H, W, 3) linear RGB, ``log_sum`` (H,) summed log luminance.

    A sample whose face was shaded in the same 2x2 block takes that colour.
    """
    height, width = near.shape
    for pair in prange(height // 2):
        scratch = np.empty((5, 3), np.float32)
        for y in range(2 * pair, 2 * pair + 2):
            total = _f(0)
            for x in range(width):
                from_x, from_y = _shaded_neighbour(seen, x, y)
                if from_x >= 0:
                    for c in range(3):
                        out[y, x, c] = out[from_y, from_x, c]
                else:
                    _shade_sample(x, y, near, seen, surface, maps, eye, light, scratch)
                    for c in range(3):
                        out[y, x, c] = scratch[0, c]
                total += np.log(_luminance(out[y, x]) + _f(0.01))
            log_sum[y] = total
