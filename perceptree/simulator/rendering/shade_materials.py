"""Numba kernels for materials: ground covers, bark with moss, snow and wetness.

The constants were chosen by eye.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from perceptree.simulator.materials.layers import (
    FIRST_CUTOUT,
    FIRST_GROUND,
    FIRST_OBJECT,
    LAST_BARK,
    MIP_LEVELS,
    Layer,
)
from perceptree.simulator.rendering.kernel_math import (
    cloud,
    face_texels,
    is_cutout,
    mip_level,
    nearest,
    normalise,
    ramp,
    sample,
    value_noise,
)

_f32 = np.float32
_FIRST_CUTOUT, _FIRST_GROUND, _LAST_BARK = int(FIRST_CUTOUT), int(FIRST_GROUND), int(LAST_BARK)
_DEAD_WOOD, _CUT_WOOD, _MUD = int(Layer.DEAD_WOOD), int(Layer.CUT_WOOD), int(Layer.MUD)
_FIRST_PLANT, _FIRST_OBJECT = int(Layer.GRASS), int(FIRST_OBJECT)
_MUD_COVER = _MUD - _FIRST_GROUND


@njit(cache=True, error_model="numpy")
def _weights(screen, i, j, k, x, y, z):
    """Perspective-correct barycentric weights at a sample, and 1 over twice the face's area, px."""
    x0, y0, x1, y1 = screen[i, 0], screen[i, 1], screen[j, 0], screen[j, 1]
    x2, y2 = screen[k, 0], screen[k, 1]
    inverse = _f32(1) / ((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
    px, py = x + _f32(0.5) - x2, y + _f32(0.5) - y2
    a = (px * (y1 - y2) + py * (x2 - x1)) * inverse
    b = (px * (y2 - y0) + py * (x0 - x2)) * inverse
    c = _f32(1) - a - b
    return a * screen[i, 2] * z, b * screen[j, 2] * z, c * screen[k, 2] * z, abs(inverse)


@njit(cache=True, error_model="numpy")
def _ground(colour, normal, point, u, v, surface, maps, level, work, texel):
    """Blend the ground covers by noise in world space; returns the gloss of the ground."""
    x, y = point[0], point[1]
    rough = _f32(0.35) * (cloud(x * _f32(2.3), y * _f32(2.3)) - _f32(0.5))
    first = value_noise(x * _f32(0.42), y * _f32(0.42)) - _f32(0.5) + rough
    second = value_noise(x * _f32(0.55) + _f32(37), y * _f32(0.55) + _f32(11)) - _f32(0.5) - rough
    best = _f32(-9)
    for k in range(4):
        swing = first if k < 2 else second
        work[k] = surface.cover[k] * _f32(1.1) + (swing if k % 2 == 0 else -swing)
        if surface.cover[k] <= 0:
            work[k] = _f32(-9)
        best = max(best, work[k])
    total = _f32(0)
    for k in range(4):
        work[k] = max(work[k] - best + _f32(0.12), _f32(0))
        total += work[k]
    rise_x, rise_y = _f32(0), _f32(0)
    for c in range(3):
        colour[c] = _f32(0)
    for k in range(4):
        if work[k] > 0:
            share = work[k] / total
            layer = _FIRST_GROUND + k
            texture_layer = maps.texture_layer[layer]
            sample(maps.albedo, maps.offsets, texture_layer, level, u, v, texel)
            for c in range(3):
                colour[c] += share * texel[c] * texel[c] * maps.gains[layer, c]
            sample(maps.relief, maps.offsets, texture_layer, level, u, v, texel)
            rise_x += share * (texel[0] * _f32(2) - _f32(1))
            rise_y += share * (texel[1] * _f32(2) - _f32(1))
    normal[0] += rise_x * _f32(0.9)
    normal[1] -= rise_y * _f32(0.9)
    shade = _f32(0.7) + _f32(0.6) * value_noise(x * _f32(0.3) + _f32(9), y * _f32(0.3))
    for c in range(3):
        colour[c] *= shade
    return _f32(0.22) * work[_MUD_COVER] / total


@njit(inline="always", cache=True, error_model="numpy")
def _height_above_ground(point, ground_m):
    size = ground_m.shape[0]
    column = min(max(int(point[0] + size * 0.5), 0), size - 1)
    row = min(max(int(point[1] + size * 0.5), 0), size - 1)
    return point[2] - ground_m[row, column]


@njit(cache=True, error_model="numpy")
def _bark(colour, normal, point, u, v, texture, surface, maps, level, work):
    """Add bark relief to the normal, and blotches and moss near the ground to the colour."""
    sample(maps.relief, maps.offsets, maps.texture_layer[texture], level, u, v, work)
    relief_x, relief_y = work[0] * _f32(2) - _f32(1), work[1] * _f32(2) - _f32(1)
    across = _f32(1) / np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + _f32(1e-6))
    east, north = -normal[1] * across, normal[0] * across
    normal[0] += _f32(1.3) * relief_x * east
    normal[1] += _f32(1.3) * relief_x * north
    normal[2] += _f32(1.3) * relief_y
    blotch = _f32(0.75) + _f32(0.5) * value_noise(
        (point[0] + point[1]) * _f32(5), point[2] * _f32(3) + point[0] * _f32(4)
    )
    low = ramp(_f32(-1.1), _f32(0.5), _f32(0.3) - _height_above_ground(point, surface.ground_m))
    if texture == _DEAD_WOOD:
        low = _f32(0)
    patch = cloud(point[0] * _f32(2) + point[2], point[1] * _f32(2) + point[2] * _f32(1.7))
    moss = ramp(_f32(0.5), _f32(0.75), patch) * low * _f32(0.8)
    colour[0] = colour[0] * blotch + (_f32(0.06) - colour[0] * blotch) * moss
    colour[1] = colour[1] * blotch + (_f32(0.085) - colour[1] * blotch) * moss
    colour[2] = colour[2] * blotch + (_f32(0.02) - colour[2] * blotch) * moss


@njit(cache=True, error_model="numpy")
def _snow(colour, normal, up, point, open_sky, texture, snow):
    """Add snow to surfaces that face up under open sky; returns the fraction of snow."""
    grain = cloud(point[0] * _f32(1.7), point[1] * _f32(1.7))
    fine = value_noise(point[0] * _f32(11), point[1] * _f32(11) + point[2] * _f32(7))
    if _FIRST_GROUND <= texture < _FIRST_CUTOUT:
        reach = snow * _f32(1.5) + open_sky * _f32(0.25) - _f32(0.45) * grain - _f32(0.15) * fine
        share = ramp(_f32(0.12), _f32(0.4), reach) * ramp(_f32(0.5), _f32(0.75), up)
    elif _FIRST_PLANT <= texture < _FIRST_OBJECT:
        share = ramp(_f32(0.1), _f32(0.6), up + _f32(0.5) * (fine - _f32(0.5))) * min(
            _f32(1), snow * _f32(1.4)
        )
    elif is_cutout(texture):
        share = ramp(_f32(0.35), _f32(0.8), up + _f32(0.5) * (fine - _f32(0.5))) * snow * open_sky
    else:
        lean = up + _f32(0.35) * (fine - _f32(0.5)) + _f32(0.2) * (grain - _f32(0.5))
        share = ramp(_f32(0.3), _f32(0.55), lean) * min(_f32(1), snow * _f32(1.6))
    light = _f32(0.66) + _f32(0.16) * fine
    colour[0] += (light - colour[0]) * share
    colour[1] += (light * _f32(1.01) - colour[1]) * share
    colour[2] += (light * _f32(1.05) - colour[2]) * share
    normal[2] += share * _f32(0.6)
    return share


@njit(cache=True, error_model="numpy")
def _paint(colour, normal, point, world, u, v, tint, level, texture, surface, maps, work, texel):
    """Albedo and textured normal of a dry surface without snow; returns its gloss."""
    texture_layer = maps.texture_layer[texture]
    if is_cutout(texture):
        nearest(maps.albedo, maps.offsets, texture_layer, level, u, v, colour)
        if normal[0] * world[0] + normal[1] * world[1] + normal[2] * world[2] > 0:
            for axis in range(3):
                normal[axis] *= _f32(0.3)
    elif _FIRST_GROUND <= texture < _FIRST_CUTOUT:
        return _ground(colour, normal, point, u, v, surface, maps, level, work, texel)
    else:
        sample(maps.albedo, maps.offsets, texture_layer, level, u, v, colour)
    for channel in range(3):
        colour[channel] *= colour[channel] * tint * maps.gains[texture, channel]
    if texture < _FIRST_GROUND and texture != _CUT_WOOD:
        _bark(colour, normal, point, u, v, texture, surface, maps, level, work)
    return _f32(0)


@njit(inline="always", cache=True, error_model="numpy")
def _wet(colour, gloss, texture, wet):
    """Darken a wet surface, and make it glossy unless it is foliage; returns the gloss."""
    foliage = is_cutout(texture)
    darker = _f32(1) - wet * (_f32(0.18) if foliage else _f32(0.45))
    for channel in range(3):
        colour[channel] *= darker
    if foliage:
        return gloss
    return min(_f32(1), gloss + wet * (_f32(0.35) if texture <= _LAST_BARK else _f32(0.5)))


@njit(cache=True, error_model="numpy")
def material(colour, normal, point, world, face, x, y, z, surface, maps, atmosphere, work, texel):
    """Compute albedo `colour` and `normal` of a face at a sample.

    Args:
        colour: (3,) receives the linear RGB albedo.
        normal: (3,) receives the normal.
        point: (3,) world position of the sample, m.
        world: (3,) ray in world axes.
        face: Number of the face.
        x: Column of the sample.
        y: Row of the sample.
        z: Depth of the sample, m.
        surface: Triangles.
        maps: Textures.
        atmosphere: Light and weather.
        work: (4,) work space.
        texel: (3,) work space.

    Returns:
        Visibility of the sky (0 to 1), whether the face is foliage, and its gloss (0 to 1).
    """
    i, j, k = surface.faces[face, 0], surface.faces[face, 1], surface.faces[face, 2]
    a, b, c, density = _weights(surface.screen, i, j, k, x, y, z)
    corners = surface.corners
    for axis in range(3):
        normal[axis] = a * corners[i, axis] + b * corners[j, axis] + c * corners[k, axis]
    u = a * corners[i, 3] + b * corners[j, 3] + c * corners[k, 3]
    v = a * corners[i, 4] + b * corners[j, 4] + c * corners[k, 4]
    tint = a * corners[i, 5] + b * corners[j, 5] + c * corners[k, 5]
    open_sky = a * corners[i, 6] + b * corners[j, 6] + c * corners[k, 6]
    texels = face_texels(corners, 3, i, j, k) * density
    level = mip_level(texels, _f32(0.6), MIP_LEVELS - 1)
    texture = int(surface.layer[face])
    normalise(normal)
    upwards = normal[2]
    gloss = _paint(
        colour, normal, point, world, u, v, tint, level, texture, surface, maps, work, texel
    )
    gloss = _wet(colour, gloss, texture, atmosphere.wet)
    if atmosphere.snow > 0:
        gloss *= _f32(1) - _snow(colour, normal, upwards, point, open_sky, texture, atmosphere.snow)
    foliage = is_cutout(texture)
    if not foliage:
        normalise(normal)
    return open_sky, foliage, gloss
