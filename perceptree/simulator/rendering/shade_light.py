"""Numba kernels of the light: cast shadow, closed-off corners, sun, sky, gloss and haze."""

from __future__ import annotations

import numpy as np
from numba import njit

from perceptree.simulator.rendering.kernel_math import cloud, luminance, ramp, value_noise

_f = np.float32
_TAPS_X = np.array([0.3, -0.55, 0.1, 0.85, -0.9, 0.2], np.float32)
_TAPS_Y = np.array([0.1, 0.45, -0.75, 0.5, -0.4, 0.95], np.float32)
_TAPS = 5


@njit(cache=True, error_model="numpy")
def _in_shadow_map(point, normal, sun, maps):
    """Column and row in the shadow map, in texels, and the nearness to compare with it."""
    rows = maps.shadow_rows
    column, row, nearness = rows[0, 3], rows[1, 3], rows[2, 3]
    for axis in range(3):
        place = point[axis] + normal[axis] * _f(0.03) + sun[axis] * _f(0.04)
        column += rows[0, axis] * place
        row += rows[1, axis] * place
        nearness += rows[2, axis] * place
    return column, row, nearness + maps.shadow_bias


@njit(cache=True, error_model="numpy")
def sunlit(point, normal, sun, maps):
    """Share of the sun that reaches a point: a 3x3 texel filter that slides without steps."""
    column, row, nearness = _in_shadow_map(point, normal, sun, maps)
    left, top = int(np.floor(column - _f(1.5))), int(np.floor(row - _f(1.5)))
    size = maps.shadow.shape[0]
    if left < 0 or top < 0 or left + 3 >= size or top + 3 >= size:
        return _f(1)
    across, down = column - _f(1.5) - left, row - _f(1.5) - top
    share = _f(0)
    for j in range(4):
        weight_y = _f(1) - down if j == 0 else down if j == 3 else _f(1)
        for i in range(4):
            if maps.shadow[top + j, left + i] <= nearness:
                weight_x = _f(1) - across if i == 0 else across if i == 3 else _f(1)
                share += weight_x * weight_y
    return share * _f(1 / 9)


@njit(cache=True, error_model="numpy")
def leaf_sunlit(point, normal, sun, maps, turn):
    """As ``sunlit``, from two texels in a random direction: enough among leaves."""
    column, row, nearness = _in_shadow_map(point, normal, sun, maps)
    size = maps.shadow.shape[0]
    share = _f(0)
    for side in (_f(-0.7), _f(0.7)):
        x, y = int(column + turn[0] * side), int(row + turn[1] * side)
        outside = x < 0 or y < 0 or x >= size or y >= size
        if outside or maps.shadow[y, x] <= nearness:
            share += _f(0.5)
    return share


@njit(cache=True, error_model="numpy")
def occlusion(near, x, y, ray, z, normal, eye, turn):
    """Screen-space ambient occlusion: how much nearby surfaces leave of the hemisphere."""
    height, width = near.shape
    radius = _f(0.33) * eye.focal_x / max(z, _f(1))
    closed = _f(0)
    for tap in range(_TAPS):
        column = int(x + (turn[0] * _TAPS_X[tap] - turn[1] * _TAPS_Y[tap]) * radius)
        row = int(y + (turn[1] * _TAPS_X[tap] + turn[0] * _TAPS_Y[tap]) * radius)
        if column < 0 or row < 0 or column >= width or row >= height or near[row, column] <= 0:
            continue
        depth = _f(1) / near[row, column]
        right = (column + _f(0.5) - eye.centre_x) / eye.focal_x * depth - ray[0] * z
        down = (row + _f(0.5) - eye.centre_y) / eye.focal_y * depth - ray[1] * z
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
    return max(_f(0), _f(1) - closed * _f(2.5 / _TAPS))


@njit(cache=True, error_model="numpy")
def backdrop(colour, world, length, towards_sun, air):
    """Far forest below a noisy skyline, above it the sky with a glow around the sun."""
    rise = world[2] / length
    share = ramp(_f(0), _f(0.55), max(rise, _f(0)))
    for c in range(3):
        horizon = max(air.haze_colour[c], air.sky_colour[c] * _f(0.8)) * _f(1.1)
        tone = horizon + (air.sky_colour[c] * _f(1.5) - horizon) * share
        colour[c] = tone * _f(1.3) + air.sun_colour[c] * _f(0.1) * towards_sun**8
    bearing = np.arctan2(world[1], world[0])
    tops = (
        _f(0.15)
        + _f(0.10) * cloud(bearing * _f(7), _f(1))
        + _f(0.09) * cloud(bearing * _f(80), _f(5))
    )
    if rise < tops:
        crowns = cloud(bearing * _f(60), rise * _f(45)) * cloud(bearing * _f(170), rise * _f(90))
        gap = ramp(_f(0.55), _f(0.75), value_noise(bearing * _f(230), _f(3)))
        dark = _f(0.06) + _f(0.30) * crowns * ramp(_f(-0.1), tops, rise) + _f(0.03) * gap
        clear = np.exp(_f(-90) * air.haze_per_m)
        level = luminance(air.sky_colour) * (dark + air.snow * _f(0.25) * crowns)
        for c in range(3):
            green = _f(0.82) if c != 1 else _f(1.12)
            colour[c] = air.haze_colour[c] * (_f(1) - clear) + level * green * clear


@njit(cache=True, error_model="numpy")
def illuminate(
    colour, normal, world, length, lit, ambient, gloss, towards_sun, path_m, foliage, air
):
    """Sun, sky, bounced light, lamp and gloss on a surface, then haze along the path to it."""
    sun = air.sun
    facing = normal[0] * sun[0] + normal[1] * sun[1] + normal[2] * sun[2]
    direct = max(facing, _f(0))
    if foliage:
        wrapped = max(facing * _f(0.6) + _f(0.4), _f(0)) * _f(0.65)
        through = max(-facing, _f(0)) * _f(0.35) + _f(0.25) * towards_sun**4
        direct = wrapped + through
    direct *= lit
    lamp = _lamp(normal, world, length, path_m, air)
    upward = normal[2] * _f(0.5) + _f(0.5)
    sky_level = (air.sky_colour[0] + air.sky_colour[1] + air.sky_colour[2]) * _f(1 / 3)
    white = _f(1) + _f(2.0) * air.snow
    for c in range(3):
        bounce = (_f(0.40) - _f(0.03) * c * (c + _f(1.2))) * sky_level * white
        bounce = min(bounce, air.sky_colour[c])
        around = bounce + (air.sky_colour[c] - bounce) * upward
        colour[c] *= air.sun_colour[c] * direct + around * ambient + lamp
    if gloss > 0:
        _shine(colour, normal, world, length, lit, ambient, gloss, air)
    grey = luminance(colour)
    clear = np.exp(-path_m * air.haze_per_m)
    glow = _f(1) + _f(0.5) * towards_sun**6 * (_f(1) - clear)
    for c in range(3):
        muted = colour[c] + (grey - colour[c]) * _f(0.15)
        colour[c] = air.haze_colour[c] * glow * (_f(1) - clear) + muted * clear


@njit(inline="always", cache=True, error_model="numpy")
def _lamp(normal, world, length, path_m, air):
    """Light of a lamp at the camera, which falls off to the picture's borders and with distance."""
    if air.lamp <= _f(0):
        return _f(0)
    facing = -(normal[0] * world[0] + normal[1] * world[1] + normal[2] * world[2]) / length
    spread = length * length * length
    return air.lamp * max(facing, _f(0.1)) / (spread * max(path_m * path_m, _f(1)))


@njit(cache=True, error_model="numpy")
def _shine(colour, normal, world, length, lit, ambient, gloss, air):
    """Reflection of the sky by Schlick's formula, rough at grazing angles, and the sun's spot."""
    facing = -(normal[0] * world[0] + normal[1] * world[1] + normal[2] * world[2]) / length
    grazing = _f(1) - min(max(facing, _f(0.2)), _f(1))
    mirror = (_f(0.02) + _f(0.16) * grazing * grazing * grazing * grazing * grazing) * gloss
    half = _f(0)
    norm = _f(0)
    for axis in range(3):
        between = air.sun[axis] - world[axis] / length
        half += normal[axis] * between
        norm += between * between
    half = max(half, _f(0)) / (np.sqrt(norm) + _f(1e-6))
    spot = gloss * lit * half**40 * _f(0.2)
    for c in range(3):
        colour[c] += mirror * _f(0.7) * ambient * air.sky_colour[c] + spot * air.sun_colour[c]
