"""Numba kernels for light: shadows, ambient occlusion, sun, sky, gloss and haze.

The light model is made for speed and plausible pictures, not for physical accuracy. Its constants
were chosen by eye, unless a source is given.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from perceptree.simulator.rendering.kernel_math import cloud, luminance, ramp, value_noise

_f32 = np.float32
# Sampling pattern of the ambient occlusion, over its radius; the first _TAPS points are used.
_TAPS_X = np.array([0.3, -0.55, 0.1, 0.85, -0.9, 0.2], np.float32)
_TAPS_Y = np.array([0.1, 0.45, -0.75, 0.5, -0.4, 0.95], np.float32)
_TAPS = 5


@njit(cache=True, error_model="numpy")
def _in_shadow_map(point, normal, sun, maps):
    """Column and row of a point in the shadow map, texels, and its nearness with the bias."""
    rows = maps.shadow_rows
    column, row, nearness = rows[0, 3], rows[1, 3], rows[2, 3]
    for axis in range(3):
        position = point[axis] + normal[axis] * _f32(0.03) + sun[axis] * _f32(0.04)
        column += rows[0, axis] * position
        row += rows[1, axis] * position
        nearness += rows[2, axis] * position
    return column, row, nearness + maps.shadow_bias


@njit(cache=True, error_model="numpy")
def sunlit(point, normal, sun, maps):
    """Fraction of the sun that reaches a point, by 3x3 percentage-closer filtering.

    The weights of the filter's border texels change continuously with the position.
    """
    column, row, nearness = _in_shadow_map(point, normal, sun, maps)
    left, top = int(np.floor(column - _f32(1.5))), int(np.floor(row - _f32(1.5)))
    size = maps.shadow.shape[0]
    if left < 0 or top < 0 or left + 3 >= size or top + 3 >= size:
        return _f32(1)
    across, down = column - _f32(1.5) - left, row - _f32(1.5) - top
    share = _f32(0)
    for j in range(4):
        weight_y = _f32(1) - down if j == 0 else down if j == 3 else _f32(1)
        for i in range(4):
            if maps.shadow[top + j, left + i] <= nearness:
                weight_x = _f32(1) - across if i == 0 else across if i == 3 else _f32(1)
                share += weight_x * weight_y
    return share * _f32(1 / 9)


@njit(cache=True, error_model="numpy")
def leaf_sunlit(point, normal, sun, maps, turn):
    """Fraction of the sun that reaches a leaf, from two shadow map texels in a random direction."""
    column, row, nearness = _in_shadow_map(point, normal, sun, maps)
    size = maps.shadow.shape[0]
    share = _f32(0)
    for side in (_f32(-0.7), _f32(0.7)):
        x, y = int(column + turn[0] * side), int(row + turn[1] * side)
        outside = x < 0 or y < 0 or x >= size or y >= size
        if outside or maps.shadow[y, x] <= nearness:
            share += _f32(0.5)
    return share


@njit(cache=True, error_model="numpy")
def occlusion(depth_buffer, x, y, ray, z, normal, camera, turn):
    """Screen-space ambient occlusion: fraction of the hemisphere that nearby surfaces leave open.

    Args:
        depth_buffer: (H, W) 1 / z.
        x: Column of the sample.
        y: Row of the sample.
        ray: Ray of the sample in camera axes, with z = 1.
        z: Depth of the sample, m.
        normal: (3,) unit normal.
        camera: Camera of the samples.
        turn: Cosine and sine of the random rotation of the sampling pattern.

    Returns:
        0 (occluded) to 1 (open).
    """
    height, width = depth_buffer.shape
    radius = _f32(0.33) * camera.focal_x / max(z, _f32(1))
    closed = _f32(0)
    for tap in range(_TAPS):
        column = int(x + (turn[0] * _TAPS_X[tap] - turn[1] * _TAPS_Y[tap]) * radius)
        row = int(y + (turn[1] * _TAPS_X[tap] + turn[0] * _TAPS_Y[tap]) * radius)
        if (
            column < 0
            or row < 0
            or column >= width
            or row >= height
            or depth_buffer[row, column] <= 0
        ):
            continue
        depth = _f32(1) / depth_buffer[row, column]
        right = (column + _f32(0.5) - camera.centre_x) / camera.focal_x * depth - ray[0] * z
        down = (row + _f32(0.5) - camera.centre_y) / camera.focal_y * depth - ray[1] * z
        away = depth - z
        squared = right * right + down * down + away * away
        facing = _f32(0)
        for axis in range(3):
            facing += normal[axis] * (
                camera.rotation[0, axis] * right
                + camera.rotation[1, axis] * down
                + camera.rotation[2, axis] * away
            )
        facing = facing / (np.sqrt(squared) + _f32(1e-3)) - _f32(0.08)
        closed += max(facing, _f32(0)) / (_f32(1) + _f32(3) * squared)
    return max(_f32(0), _f32(1) - closed * _f32(2.5 / _TAPS))


@njit(cache=True, error_model="numpy")
def backdrop(colour, world, length, towards_sun, atmosphere):
    """Colour of the background: distant forest below an irregular skyline, and sky above.

    The sky is a gradient from the horizon to the zenith with a glow around the sun.
    """
    rise = world[2] / length
    share = ramp(_f32(0), _f32(0.55), max(rise, _f32(0)))
    for c in range(3):
        horizon = max(atmosphere.haze_colour[c], atmosphere.sky_colour[c] * _f32(0.8)) * _f32(1.1)
        tone = horizon + (atmosphere.sky_colour[c] * _f32(1.5) - horizon) * share
        colour[c] = tone * _f32(1.3) + atmosphere.sun_colour[c] * _f32(0.1) * towards_sun**8
    bearing = np.arctan2(world[1], world[0])
    tops = (
        _f32(0.15)
        + _f32(0.10) * cloud(bearing * _f32(7), _f32(1))
        + _f32(0.09) * cloud(bearing * _f32(80), _f32(5))
    )
    if rise < tops:
        crowns = cloud(bearing * _f32(60), rise * _f32(45)) * cloud(
            bearing * _f32(170), rise * _f32(90)
        )
        gap = ramp(_f32(0.55), _f32(0.75), value_noise(bearing * _f32(230), _f32(3)))
        dark = _f32(0.06) + _f32(0.30) * crowns * ramp(_f32(-0.1), tops, rise) + _f32(0.03) * gap
        clear = np.exp(_f32(-90) * atmosphere.haze_per_m)
        level = luminance(atmosphere.sky_colour) * (dark + atmosphere.snow * _f32(0.25) * crowns)
        for c in range(3):
            green = _f32(0.82) if c != 1 else _f32(1.12)
            colour[c] = atmosphere.haze_colour[c] * (_f32(1) - clear) + level * green * clear


@njit(cache=True, error_model="numpy")
def illuminate(
    colour, normal, world, length, lit, ambient, gloss, towards_sun, path_m, foliage, atmosphere
):
    """Turn the albedo `colour` (3,) into reflected light, and add haze along the path.

    Light comes from the sun, the sky, the ground (bounced), and a lamp at the camera. Surfaces
    are Lambertian with an optional gloss; foliage also transmits light from behind. Haze follows
    Koschmieder (1924): contrast decreases with exp(-extinction * distance).

    Args:
        colour: (3,) linear RGB albedo, changed to light in place.
        normal: (3,) unit normal.
        world: (3,) ray in world axes.
        length: Length of the ray.
        lit: Fraction of the sun that reaches the surface.
        ambient: Fraction of ambient light that reaches the surface.
        gloss: Strength of the gloss, 0 to 1.
        towards_sun: Cosine of the angle between ray and sun, at least 0.
        path_m: Distance from the camera, m.
        foliage: Whether the surface is foliage.
        atmosphere: Light and weather.
    """
    if atmosphere.infrared > _f32(0):
        _reflect_infrared(colour)
    sun = atmosphere.sun
    facing = normal[0] * sun[0] + normal[1] * sun[1] + normal[2] * sun[2]
    direct = max(facing, _f32(0))
    if foliage:
        wrapped = max(facing * _f32(0.6) + _f32(0.4), _f32(0)) * _f32(0.65)
        through = max(-facing, _f32(0)) * _f32(0.35) + _f32(0.25) * towards_sun**4
        direct = wrapped + through
    direct *= lit
    lamp = _lamp(normal, world, length, path_m, foliage, atmosphere)
    upward = normal[2] * _f32(0.5) + _f32(0.5)
    sky_level = (
        atmosphere.sky_colour[0] + atmosphere.sky_colour[1] + atmosphere.sky_colour[2]
    ) * _f32(1 / 3)
    white = _f32(1) + _f32(2.0) * atmosphere.snow
    for c in range(3):
        bounce = (_f32(0.40) - _f32(0.03) * c * (c + _f32(1.2))) * sky_level * white
        bounce = min(bounce, atmosphere.sky_colour[c])
        around = bounce + (atmosphere.sky_colour[c] - bounce) * upward
        colour[c] *= atmosphere.sun_colour[c] * direct + around * ambient + lamp
    if gloss > 0:
        _shine(colour, normal, world, length, lit, ambient, gloss, atmosphere)
    grey = luminance(colour)
    clear = np.exp(-path_m * atmosphere.haze_per_m)
    glow = _f32(1) + _f32(0.5) * towards_sun**6 * (_f32(1) - clear)
    for c in range(3):
        muted = colour[c] + (grey - colour[c]) * _f32(0.15)
        colour[c] = atmosphere.haze_colour[c] * glow * (_f32(1) - clear) + muted * clear


@njit(inline="always", cache=True, error_model="numpy")
def _reflect_infrared(colour):
    """Turn an albedo (3,) into a near-infrared one: grey, leaves bright, nothing quite black."""
    blue, green, red = colour[2], colour[1], colour[0]
    leaf = max(green - _f32(0.5) * (red + blue), _f32(0))
    grey = _f32(0.7) * red + _f32(0.2) * green + _f32(0.1) * blue + _f32(2.5) * leaf
    reflected = min(_f32(0.03) + _f32(0.95) * grey ** _f32(0.8), _f32(0.9))
    for c in range(3):
        colour[c] = reflected


@njit(inline="always", cache=True, error_model="numpy")
def _lamp(normal, world, length, path_m, foliage, atmosphere):
    """Light of a lamp at the camera, which decreases with distance and off the optical axis.

    Only infrared lamps dazzle at less than 1 m, and shine through leaves.
    """
    if atmosphere.lamp <= _f32(0):
        return _f32(0)
    facing = -(normal[0] * world[0] + normal[1] * world[1] + normal[2] * world[2]) / length
    spread = length * length * length
    if atmosphere.infrared > _f32(0):
        least = _f32(0.1)
        if foliage:
            facing, least = abs(facing), _f32(0.4)
        return atmosphere.lamp * max(facing, least) / (spread * max(path_m * path_m, _f32(0.04)))
    return atmosphere.lamp * max(facing, _f32(0.1)) / (spread * max(path_m * path_m, _f32(1)))


@njit(cache=True, error_model="numpy")
def _shine(colour, normal, world, length, lit, ambient, gloss, atmosphere):
    """Add the reflections of the sky and the sun.

    The sky's reflection follows Schlick's approximation (1994) with a limit at grazing angles; the
    sun's is a Blinn-Phong highlight (Blinn 1977).
    """
    facing = -(normal[0] * world[0] + normal[1] * world[1] + normal[2] * world[2]) / length
    grazing = _f32(1) - min(max(facing, _f32(0.2)), _f32(1))
    mirror = (_f32(0.02) + _f32(0.16) * grazing * grazing * grazing * grazing * grazing) * gloss
    half = _f32(0)
    norm = _f32(0)
    for axis in range(3):
        between = atmosphere.sun[axis] - world[axis] / length
        half += normal[axis] * between
        norm += between * between
    half = max(half, _f32(0)) / (np.sqrt(norm) + _f32(1e-6))
    spot = gloss * lit * half**40 * _f32(0.2)
    for c in range(3):
        colour[c] += (
            mirror * _f32(0.7) * ambient * atmosphere.sky_colour[c]
            + spot * atmosphere.sun_colour[c]
        )
