"""Textures of all materials with mip levels, in flat arrays for the kernels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from basetree.arrays import Float, Int64, UInt8
from perceptree.simulator.materials.barks import bark_layers
from perceptree.simulator.materials.foliage import foliage_layers
from perceptree.simulator.materials.ground import ground_layers
from perceptree.simulator.materials.layers import MIP_LEVELS, SIZE_PX, Layer
from perceptree.simulator.materials.manmade import manmade_layers
from perceptree.simulator.materials.plants import low_plant_layers, plant_layers


@dataclass(frozen=True)
class Textures:
    """All layers and their mip levels in flat arrays. Within a level the layers are consecutive.

    Attributes:
        albedo: (N, 4) uint8 square root of linear RGB, and alpha.
        alpha: (N,) uint8 alpha.
        normals: (N, 3) uint8 normals, 128 being zero.
        offsets: (levels,) first texel of each mip level.
    """

    albedo: UInt8
    alpha: UInt8
    normals: UInt8
    offsets: Int64


def _normals(height: Float) -> Float:
    dx = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * 1.6
    dy = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * 1.6
    normal = np.stack([-dx, dy, np.ones_like(dx)], -1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True) * 0.5 + 0.5)


_SIZES = [SIZE_PX >> level for level in range(MIP_LEVELS)]


def _mip_levels(layer: Float) -> list[Float]:
    """The mip levels of a layer (S, S, C)."""
    levels = [layer]
    for _ in range(MIP_LEVELS - 1):
        quads = layer[::2, ::2] + layer[1::2, ::2] + layer[::2, 1::2] + layer[1::2, 1::2]
        layer = quads / 4
        levels.append(layer)
    return levels


def _bytes(values: Float) -> UInt8:
    return (values.reshape(-1, values.shape[-1]) * 255 + 0.5).astype(np.uint8)


def layer_texels(textures: Textures, layer: int, level: int) -> slice:
    """The texels of a layer at a mip level."""
    first = int(textures.offsets[level]) + layer * _SIZES[level] ** 2
    return slice(first, first + _SIZES[level] ** 2)


def pack_layer(textures: Textures, layer: int, linear: Float, normals: Float) -> None:
    """Write a layer and its mip levels; without alpha, the layer keeps its outline.

    Args:
        textures: Textures to write to.
        layer: Number of the layer.
        linear: (SIZE, SIZE, 3 or 4) float32 linear RGB, and alpha.
        normals: (SIZE, SIZE, 3) float32 normals, 0.5 being zero.
    """
    slopes = _mip_levels(normals)
    for level, (tone, slope) in enumerate(zip(_mip_levels(linear), slopes, strict=True)):
        texels = layer_texels(textures, layer, level)
        root = np.concatenate([np.sqrt(tone[..., :3]), tone[..., 3:]], -1)
        textures.albedo[texels, : root.shape[-1]] = _bytes(root)
        textures.normals[texels] = _bytes(slope)


def make_textures(seed: int = 0) -> Textures:
    """Draw the textures of all layers. The same seed gives the same bytes."""
    rng = np.random.default_rng(seed)
    offsets = np.cumsum([0] + [len(Layer) * size * size for size in _SIZES])
    albedo = np.empty((offsets[-1], 4), np.uint8)
    normals = np.empty((offsets[-1], 3), np.uint8)
    textures = Textures(albedo, albedo[:, 3], normals, offsets[:-1])

    def pack(layer: Layer, colour: Float, height: Float) -> None:
        linear = np.clip(colour, 0, 1).astype(np.float32)
        linear[..., :3] **= 2.2
        pack_layer(textures, layer, linear, _normals(height).astype(np.float32))

    additions_rng = np.random.default_rng([seed, 1])
    opaque, flat = np.ones((SIZE_PX, SIZE_PX, 1)), np.zeros((SIZE_PX, SIZE_PX))
    for solid, source in (
        (bark_layers, rng),
        (ground_layers, rng),
        (manmade_layers, additions_rng),
    ):
        for layer, (colour, height) in solid(source).items():
            pack(layer, np.concatenate([colour, opaque], -1), height)
    cut_outs = ((foliage_layers, rng), (plant_layers, rng), (low_plant_layers, additions_rng))
    for cut_out, source in cut_outs:
        for layer, colour in cut_out(source).items():
            pack(layer, colour, flat)
    return replace(textures, alpha=albedo[:, 3].copy())
