"""Numba kernel of the forest beyond the simulated stand: trunks, crowns and bushes in the haze."""

from __future__ import annotations

import numpy as np
from numba import njit

from perceptree.simulator.rendering.kernel_math import cloud, hashed, luminance, ramp, value_noise

_f = np.float32
_ROWS = 6
_NEAREST_M, _FARTHEST_M = _f(43), _f(115)
_SPACING_M = _f(1.6)
_SPARSE_M = _f(5)
_AIR_LIGHT_PER_M = _f(0.0025)
_TRUNK_M = _f(17)


@njit(cache=True, error_model="numpy")
def far_forest(colour, world, length, towards_sun, air):
    """Draw rows of trees over ``colour``, which holds what lies behind them, the farthest first.

    Each row is a cylinder about the camera, cut into cells that hold one trunk each.
    """
    across = np.sqrt(world[0] * world[0] + world[1] * world[1]) + _f(1e-6)
    climb = world[2] / across
    bearing = np.arctan2(world[1], world[0])
    sky = luminance(air.sky_colour)
    spacing_m = _SPACING_M + _SPARSE_M * (_f(1) - air.backdrop)
    for row in range(_ROWS):
        share = _f(row) / _f(_ROWS - 1)
        distance_m = _FARTHEST_M + (_NEAREST_M - _FARTHEST_M) * np.sqrt(share)
        height_m = climb * distance_m
        shift = air.backdrop_seed + _f(31) * row
        along_m = bearing * distance_m
        clear = np.exp(-distance_m * (air.haze_per_m + _AIR_LIGHT_PER_M))
        shade = _leaves(along_m, height_m, shift, air)
        green = shade > _f(0)
        if not green:
            shade = _trunk(along_m, height_m, spacing_m, shift, towards_sun)
        if shade > _f(0):
            sunny = ramp(_f(0.55), _f(0.75), value_noise(along_m * _f(0.4) + shift, height_m))
            for c in range(3):
                tint = _f(1)
                if green:
                    tint = _f(1.25) if c == 1 else _f(0.75) if c == 0 else _f(0.45)
                light = sky * _f(0.55) + _f(0.22) * sunny * air.sun_colour[c]
                seen = shade * tint * light
                colour[c] = air.haze_colour[c] * (_f(1) - clear) + seen * clear


@njit(inline="always", cache=True, error_model="numpy")
def _trunk(along_m, height_m, spacing_m, shift, towards_sun):
    """Albedo of a row's trunk at a place, or 0 between trunks."""
    cell = int(np.floor(along_m / spacing_m))
    key = int(shift)
    if hashed(cell, key) > _f(0.86) or height_m > _TRUNK_M:
        return _f(0)
    lean_m = (hashed(cell, key + 3) - _f(0.5)) * _f(0.14) * height_m
    middle_m = (_f(cell) + _f(0.3) + _f(0.4) * hashed(cell, key + 1)) * spacing_m + lean_m
    thick = hashed(cell, key + 2)
    taper = max(_f(0.2), _f(1) - height_m * _f(0.04))
    radius_m = (_f(0.05) + _f(0.17) * thick * thick) * taper
    place = (along_m - middle_m) / radius_m
    if abs(place) > _f(1):
        return _f(0)
    albedo = _f(0.08) + _f(0.30) * hashed(cell, key + 4)
    rough = _f(0.75) + _f(0.5) * value_noise(along_m * _f(14), height_m * _f(3))
    return albedo * rough * (_f(1) - _f(0.45) * place * place) * (_f(1) - _f(0.4) * towards_sun)


@njit(inline="always", cache=True, error_model="numpy")
def _leaves(along_m, height_m, shift, air):
    """Albedo of crowns above and bushes below in a row, or 0 where one looks through."""
    broad = value_noise(along_m * _f(0.21) + shift, shift)
    base_m = _f(3) + _f(11) * broad
    top_m = _f(15) + _f(10) * value_noise(along_m * _f(0.35) + shift, _f(2) * shift)
    leaf = cloud(along_m * _f(1.4) + shift, height_m * _f(1.9))
    crown = ramp(base_m, base_m + _f(5), height_m) * (_f(1) - ramp(top_m - _f(6), top_m, height_m))
    bush_m = _f(2.6) * value_noise(along_m * _f(0.5) + shift, shift + _f(9)) - _f(0.7)
    bush = _f(1) - ramp(bush_m - _f(0.4), bush_m + _f(0.3), height_m)
    cover = max(crown * _f(0.95), bush)
    if leaf > _f(0.18) + _f(0.62) * cover:
        return _f(0)
    fine = value_noise(along_m * _f(7), height_m * _f(9) + shift)
    return (_f(0.05) + _f(0.20) * fine * (_f(0.4) + leaf)) * (_f(1) + _f(2) * air.snow)
