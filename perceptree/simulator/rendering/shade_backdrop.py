"""Numba kernel for the forest beyond the simulated stand: trunks, crowns and bushes in haze."""

from __future__ import annotations

import numpy as np
from numba import njit

from perceptree.simulator.rendering.kernel_math import cloud, hashed, luminance, ramp, value_noise

_f32 = np.float32
_ROWS = 6
_NEAREST_M, _FARTHEST_M = _f32(43), _f32(115)
_SPACING_M = _f32(1.6)  # distance of trunks in a row of a dense forest
_SPARSE_M = _f32(5)  # what a sparse forest adds to it
_AIR_LIGHT_PER_M = _f32(0.0025)  # extinction in addition to the scene's
_TRUNK_M = _f32(17)  # height of trunks
_PHOTOGRAPHED_M = _f32(90)  # haze in front of a photographed far stand, as over this distance
_SKY_GAIN = _f32(1.8)  # luminance of its bright sky over that of the scene's sky colour


@njit(cache=True, error_model="numpy")
def photographed(colour, world, maps, atmosphere):
    """Draw a photographed sky and far stand.

    The panorama is a cylinder around the camera whose pictures are made smaller, as if everything
    in it were that many times as far away: bearings and slopes are multiplied before it is looked
    up. Its light follows the scene's sky.

    Args:
        colour: (3,) receives linear RGB.
        world: (3,) ray in world axes.
        maps: The panorama.
        atmosphere: Light and weather.
    """
    root = maps.far_root
    height, width = root.shape[0], root.shape[1]
    shrink, turn, gain = maps.far_view[0], maps.far_view[1], maps.far_view[2]
    across = np.sqrt(world[0] * world[0] + world[1] * world[1]) + _f32(1e-6)
    climb = np.arctan(shrink * world[2] / across)
    turns = np.arctan2(world[1], world[0]) * _f32(0.15915494)
    x = (turn - shrink * turns) * width
    y = (_f32(0.5) - climb * _f32(0.31830989)) * height - _f32(0.5)
    y = min(max(y, _f32(0)), _f32(height - 1))
    column, row = int(np.floor(x)), min(int(y), height - 2)
    right, down = _f32(x - np.floor(x)), _f32(y - row)
    first, second = column % width, (column + 1) % width
    sky = luminance(atmosphere.sky_colour)
    clear = np.exp(-_PHOTOGRAPHED_M * atmosphere.haze_per_m)
    for c in range(3):
        upper = (_f32(1) - right) * root[row, first, c]
        upper += right * root[row, second, c]
        lower = (_f32(1) - right) * root[row + 1, first, c]
        lower += right * root[row + 1, second, c]
        tone = (upper + (lower - upper) * down) * _f32(1 / 255)
        light = np.sqrt(sky * atmosphere.sky_colour[c]) * _SKY_GAIN * gain
        colour[c] = atmosphere.haze_colour[c] * (_f32(1) - clear) + tone * tone * light * clear


@njit(cache=True, error_model="numpy")
def far_forest(colour, world, length, towards_sun, atmosphere):
    """Draw rows of distant trees over a background colour, the farthest row first.

    Each row is a cylinder around the camera, divided into cells with one trunk each.

    Args:
        colour: (3,) linear RGB of the background, changed in place.
        world: (3,) ray in world axes.
        length: Length of the ray.
        towards_sun: Cosine of the angle between ray and sun, at least 0.
        atmosphere: Light and weather.
    """
    across = np.sqrt(world[0] * world[0] + world[1] * world[1]) + _f32(1e-6)
    climb = world[2] / across
    bearing = np.arctan2(world[1], world[0])
    sky = luminance(atmosphere.sky_colour)
    spacing_m = _SPACING_M + _SPARSE_M * (_f32(1) - atmosphere.backdrop)
    for row in range(_ROWS):
        share = _f32(row) / _f32(_ROWS - 1)
        distance_m = _FARTHEST_M + (_NEAREST_M - _FARTHEST_M) * np.sqrt(share)
        height_m = climb * distance_m
        shift = atmosphere.backdrop_seed + _f32(31) * row
        along_m = bearing * distance_m
        clear = np.exp(-distance_m * (atmosphere.haze_per_m + _AIR_LIGHT_PER_M))
        shade = _leaves(along_m, height_m, shift, atmosphere)
        green = shade > _f32(0)
        if not green:
            shade = _trunk(along_m, height_m, spacing_m, shift, towards_sun)
        if shade > _f32(0):
            sunny = ramp(_f32(0.55), _f32(0.75), value_noise(along_m * _f32(0.4) + shift, height_m))
            for c in range(3):
                tint = _f32(1)
                if green:
                    tint = _f32(1.25) if c == 1 else _f32(0.75) if c == 0 else _f32(0.45)
                light = sky * _f32(0.55) + _f32(0.22) * sunny * atmosphere.sun_colour[c]
                seen = shade * tint * light
                colour[c] = atmosphere.haze_colour[c] * (_f32(1) - clear) + seen * clear


@njit(inline="always", cache=True, error_model="numpy")
def _trunk(along_m, height_m, spacing_m, shift, towards_sun):
    """Albedo of a row's trunk at a position; 0 between trunks."""
    cell = int(np.floor(along_m / spacing_m))
    key = int(shift)
    if hashed(cell, key) > _f32(0.86) or height_m > _TRUNK_M:
        return _f32(0)
    lean_m = (hashed(cell, key + 3) - _f32(0.5)) * _f32(0.14) * height_m
    middle_m = (_f32(cell) + _f32(0.3) + _f32(0.4) * hashed(cell, key + 1)) * spacing_m + lean_m
    thick = hashed(cell, key + 2)
    taper = max(_f32(0.2), _f32(1) - height_m * _f32(0.04))
    radius_m = (_f32(0.05) + _f32(0.17) * thick * thick) * taper
    offset = (along_m - middle_m) / radius_m
    if abs(offset) > _f32(1):
        return _f32(0)
    albedo = _f32(0.08) + _f32(0.30) * hashed(cell, key + 4)
    rough = _f32(0.75) + _f32(0.5) * value_noise(along_m * _f32(14), height_m * _f32(3))
    return (
        albedo
        * rough
        * (_f32(1) - _f32(0.45) * offset * offset)
        * (_f32(1) - _f32(0.4) * towards_sun)
    )


@njit(inline="always", cache=True, error_model="numpy")
def _leaves(along_m, height_m, shift, atmosphere):
    """Albedo of a row's crowns and bushes at a position; 0 in gaps."""
    broad = value_noise(along_m * _f32(0.21) + shift, shift)
    base_m = _f32(3) + _f32(11) * broad
    top_m = _f32(15) + _f32(10) * value_noise(along_m * _f32(0.35) + shift, _f32(2) * shift)
    leaf = cloud(along_m * _f32(1.4) + shift, height_m * _f32(1.9))
    crown = ramp(base_m, base_m + _f32(5), height_m) * (
        _f32(1) - ramp(top_m - _f32(6), top_m, height_m)
    )
    bush_m = _f32(2.6) * value_noise(along_m * _f32(0.5) + shift, shift + _f32(9)) - _f32(0.7)
    bush = _f32(1) - ramp(bush_m - _f32(0.4), bush_m + _f32(0.3), height_m)
    cover = max(crown * _f32(0.95), bush)
    if leaf > _f32(0.18) + _f32(0.62) * cover:
        return _f32(0)
    fine = value_noise(along_m * _f32(7), height_m * _f32(9) + shift)
    return (_f32(0.05) + _f32(0.20) * fine * (_f32(0.4) + leaf)) * (
        _f32(1) + _f32(2) * atmosphere.snow
    )
