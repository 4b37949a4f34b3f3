"""The shading kernel: from the triangle seen at each sample to its colour."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from perceptree.simulator.rendering.kernel_math import luminance
from perceptree.simulator.rendering.shade_backdrop import far_forest
from perceptree.simulator.rendering.shade_light import (
    backdrop,
    illuminate,
    leaf_sunlit,
    occlusion,
    sunlit,
)
from perceptree.simulator.rendering.shade_materials import material

_f = np.float32
_SAME_DEPTH = _f(0.015)
_SAME_LEAVES = _f(0.04)
_LEAF_OPENNESS = _f(0.75)


@njit(cache=True, error_model="numpy")
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


@njit(inline="always", cache=True, error_model="numpy")
def _like_last(near, seen, x, y, layer, shared):
    """Whether a sample is foliage of the kind and depth that its block shaded last."""
    t = seen[y, x]
    if t < 0 or layer[t] != shared[3]:
        return False
    return abs(shared[0] * near[y, x] - _f(1)) < _SAME_LEAVES


@njit(cache=True, error_model="numpy")
def _shade_sample(x, y, near, seen, surface, maps, eye, air, scratch, shared):
    """Colour of one sample into ``scratch[0]``; the other arrays are work space.

    ``shared`` keeps depth, sunlight and openness of the block's last sample, which one that lies
    as deep takes over, and its layer if it is foliage, else -1.
    """
    colour, ray, world, point, normal, work, texel = scratch
    ray[0] = (x + _f(0.5) - eye.centre_x) / eye.focal_x
    ray[1] = (y + _f(0.5) - eye.centre_y) / eye.focal_y
    length = np.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + _f(1))
    towards_sun = _f(0)
    for axis in range(3):
        across = eye.rotation[0, axis] * ray[0] + eye.rotation[1, axis] * ray[1]
        world[axis] = across + eye.rotation[2, axis]
        towards_sun += world[axis] * air.sun[axis]
    towards_sun = max(towards_sun / length, _f(0))
    t = seen[y, x]
    if t < 0:
        backdrop(colour, world, length, towards_sun, air)
        if air.backdrop > _f(0):
            far_forest(colour, world, length, towards_sun, air)
        return
    z = _f(1) / near[y, x]
    for axis in range(3):
        point[axis] = eye.origin[axis] + world[axis] * z
    open_sky, foliage, gloss = material(
        colour, normal, point, world, t, x, y, z, surface, maps, air, work, texel
    )
    shared[3] = _f(surface.layer[t]) if foliage else _f(-1)
    if abs(shared[0] - z) > _SAME_DEPTH * z:
        grain = _f(52.9829189) * ((_f(0.06711056) * x + _f(0.00583715) * y) % _f(1))
        angle = (grain % _f(1)) * _f(6.2831)
        turn = (np.cos(angle), np.sin(angle))
        shared[0] = z
        if foliage:
            shared[1] = leaf_sunlit(point, normal, air.sun, maps, turn)
            shared[2] = _LEAF_OPENNESS
        else:
            shared[1] = sunlit(point, normal, air.sun, maps)
            shared[2] = occlusion(near, x, y, ray, z, normal, eye, turn)
    illuminate(
        colour,
        normal,
        world,
        length,
        shared[1],
        open_sky * shared[2],
        gloss,
        towards_sun,
        z * length,
        foliage,
        air,
    )


@njit(parallel=True, cache=True, error_model="numpy")
def shade_samples(near, seen, surface, maps, eye, air, out, log_sum):
    """Light every sample; ``out`` (H, W, 3) linear RGB, ``log_sum`` (H / 2,) of log luminance.

    Samples are taken in 2x2 blocks. One whose face was shaded in its block takes that colour, as
    does foliage among foliage of its kind; a block's first sample counts for the mean luminance.
    """
    height, width = near.shape
    for pair in prange(height // 2):
        colour = np.empty(3, np.float32)
        scratch = (
            colour,
            np.empty(3, np.float32),
            np.empty(3, np.float32),
            np.empty(3, np.float32),
            np.empty(3, np.float32),
            np.empty(4, np.float32),
            np.empty(3, np.float32),
        )
        shared = np.zeros(4, np.float32)
        total = _f(0)
        for column in range(width // 2):
            shared[0], shared[3] = _f(0), _f(-1)
            for corner in range(4):
                x, y = 2 * column + (corner & 1), 2 * pair + (corner >> 1)
                from_x, from_y = _shaded_neighbour(seen, x, y)
                if from_x >= 0:
                    for c in range(3):
                        out[y, x, c] = out[from_y, from_x, c]
                    continue
                if not _like_last(near, seen, x, y, surface.layer, shared):
                    _shade_sample(x, y, near, seen, surface, maps, eye, air, scratch, shared)
                for c in range(3):
                    out[y, x, c] = colour[c]
                if corner == 0:
                    total += np.log(luminance(colour) + _f(0.01))
        log_sum[pair] = total
