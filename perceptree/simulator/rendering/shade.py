"""The shading kernel: computes the colour of each sample from its face."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from perceptree.simulator.rendering.kernel_math import luminance
from perceptree.simulator.rendering.shade_backdrop import far_forest, photographed
from perceptree.simulator.rendering.shade_light import (
    backdrop,
    illuminate,
    leaf_sunlit,
    occlusion,
    sunlit,
)
from perceptree.simulator.rendering.shade_materials import material

_f32 = np.float32
# Relative depth differences within which samples of a block share light, and foliage its colour.
_SAME_DEPTH = _f32(0.015)
_SAME_LEAVES = _f32(0.04)
# Ambient light that other leaves let through.
_LEAF_OPENNESS = _f32(0.75)
# Entries of ``shared``, the values that the samples of a 2x2 block share.
_DEPTH, _SUNLIT, _OPENNESS, _FOLIAGE_LAYER = 0, 1, 2, 3


@njit(cache=True, error_model="numpy")
def _shaded_neighbour(face_buffer, x, y):
    """Column and row of an already shaded sample of the same face in this 2x2 block, or -1."""
    face = face_buffer[y, x]
    if (x & 1) == 1 and face_buffer[y, x - 1] == face:
        return x - 1, y
    if (y & 1) == 1 and face_buffer[y - 1, x] == face:
        return x, y - 1
    if (y & 1) == 1 and face_buffer[y - 1, x ^ 1] == face:
        return x ^ 1, y - 1
    return -1, -1


@njit(inline="always", cache=True, error_model="numpy")
def _like_last_foliage(depth_buffer, face_buffer, x, y, layer, shared):
    """Whether a sample is foliage of the same layer and depth as its block's last shaded one."""
    face = face_buffer[y, x]
    if face < 0 or layer[face] != shared[_FOLIAGE_LAYER]:
        return False
    return abs(shared[_DEPTH] * depth_buffer[y, x] - _f32(1)) < _SAME_LEAVES


@njit(cache=True, error_model="numpy")
def _shade_sample(x, y, depth_buffer, face_buffer, surface, maps, camera, atmosphere, scratch):
    """Compute the colour of one sample into `scratch[0]`; the other arrays are work space.

    The last one holds the values of the last shaded sample of the block: depth, sunlight and
    ambient openness, which samples of equal depth reuse, and its layer if it is foliage, else -1.
    """
    colour, ray, world, point, normal, work, texel, shared = scratch
    ray[0] = (x + _f32(0.5) - camera.centre_x) / camera.focal_x
    ray[1] = (y + _f32(0.5) - camera.centre_y) / camera.focal_y
    length = np.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + _f32(1))
    towards_sun = _f32(0)
    for axis in range(3):
        across = camera.rotation[0, axis] * ray[0] + camera.rotation[1, axis] * ray[1]
        world[axis] = across + camera.rotation[2, axis]
        towards_sun += world[axis] * atmosphere.sun[axis]
    towards_sun = max(towards_sun / length, _f32(0))
    face = face_buffer[y, x]
    if face < 0:
        if maps.far_root.shape[0] > 1:
            photographed(colour, world, maps, atmosphere)
        else:
            backdrop(colour, world, length, towards_sun, atmosphere)
        if atmosphere.backdrop > _f32(0):
            far_forest(colour, world, length, towards_sun, atmosphere)
        return
    z = _f32(1) / depth_buffer[y, x]
    for axis in range(3):
        point[axis] = camera.origin[axis] + world[axis] * z
    open_sky, foliage, gloss = material(
        colour, normal, point, world, face, x, y, z, surface, maps, atmosphere, work, texel
    )
    shared[_FOLIAGE_LAYER] = _f32(surface.layer[face]) if foliage else _f32(-1)
    if abs(shared[_DEPTH] - z) > _SAME_DEPTH * z:
        # Interleaved gradient noise (Jimenez 2014) gives each sample a rotation.
        grain = _f32(52.9829189) * ((_f32(0.06711056) * x + _f32(0.00583715) * y) % _f32(1))
        angle = (grain % _f32(1)) * _f32(6.2831)
        turn = (np.cos(angle), np.sin(angle))
        shared[_DEPTH] = z
        if foliage:
            shared[_SUNLIT] = leaf_sunlit(point, normal, atmosphere.sun, maps, turn)
            shared[_OPENNESS] = _LEAF_OPENNESS
        else:
            shared[_SUNLIT] = sunlit(point, normal, atmosphere.sun, maps)
            shared[_OPENNESS] = occlusion(depth_buffer, x, y, ray, z, normal, camera, turn)
    illuminate(
        colour,
        normal,
        world,
        length,
        shared[_SUNLIT],
        open_sky * shared[_OPENNESS],
        gloss,
        towards_sun,
        z * length,
        foliage,
        atmosphere,
    )


@njit(parallel=True, cache=True, error_model="numpy")
def shade_samples(depth_buffer, face_buffer, surface, maps, camera, atmosphere, out, log_sum):
    """Compute the colour of every sample.

    Samples are shaded in 2x2 blocks. A sample takes the colour of another one in its block if
    both show the same face, or foliage of the same layer at nearly the same depth. The first
    sample of each block counts for the mean luminance.

    Args:
        depth_buffer: (H, W) float32 1 / z.
        face_buffer: (H, W) int32 face, -1 for sky.
        surface: Triangles.
        maps: Textures and shadow map.
        camera: Camera of the samples.
        atmosphere: Light and weather.
        out: (H, W, 3) float32, receives linear RGB.
        log_sum: (H / 2,) float32, receives sums of log luminance over pairs of rows.
    """
    height, width = depth_buffer.shape
    for pair in prange(height // 2):
        colour, ray, world = np.empty(3, _f32), np.empty(3, _f32), np.empty(3, _f32)
        point, normal, texel = np.empty(3, _f32), np.empty(3, _f32), np.empty(3, _f32)
        work, shared = np.empty(4, _f32), np.zeros(4, _f32)
        scratch = (colour, ray, world, point, normal, work, texel, shared)
        total = _f32(0)
        for column in range(width // 2):
            shared[_DEPTH], shared[_FOLIAGE_LAYER] = _f32(0), _f32(-1)
            for corner in range(4):
                x, y = 2 * column + (corner & 1), 2 * pair + (corner >> 1)
                from_x, from_y = _shaded_neighbour(face_buffer, x, y)
                if from_x >= 0:
                    for c in range(3):
                        out[y, x, c] = out[from_y, from_x, c]
                    continue
                if not _like_last_foliage(depth_buffer, face_buffer, x, y, surface.layer, shared):
                    _shade_sample(
                        x, y, depth_buffer, face_buffer, surface, maps, camera, atmosphere, scratch
                    )
                for c in range(3):
                    out[y, x, c] = colour[c]
                if corner == 0:
                    total += np.log(luminance(colour) + _f32(0.01))
        log_sum[pair] = total
