"""Meshes of small plants, made of cards with cut-out textures."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.geometry.mesh import Cards, Mesh, make_mesh, merge, tube_faces, tubes_mesh
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.vectors import UP, unit


def grass_tuft(rng: np.random.Generator) -> Mesh:
    """A tuft of green grass, about 0.35 m high; 12 faces."""
    return _tuft(rng, Layer.GRASS, 0.36, 0.35)


def dry_grass(rng: np.random.Generator) -> Mesh:
    """A tuft of dry, strongly leaning grass, about 0.3 m high; 12 faces."""
    return _tuft(rng, Layer.DRY_GRASS, 0.38, 0.75)


def fern(rng: np.random.Generator) -> Mesh:
    """A fern with arching fronds, about 0.5 m high; 66 faces."""
    count = 11
    azimuth = np.arange(count) * 2 * np.pi / count + rng.normal(0, 0.2, count)
    outwards = directions(azimuth)
    rise = rng.uniform(1.1, 2.8, (count, 1))
    length = rng.uniform(0.5, 0.78, count)
    across = directions(azimuth + np.pi / 2) + UP * rng.normal(0, 0.2, (count, 1))
    foot, width = 0.04 * outwards - 0.02 * UP, length * rng.uniform(0.36, 0.46, count)
    cards = Cards(foot, unit(outwards + rise * UP), unit(across), length, width)
    return strips(cards, 3, 0.32 + 0.1 * rise[:, 0], Layer.FERN, (0.5, 1.0))


def scrub(rng: np.random.Generator) -> Mesh:
    """A bush of upright leafy shoots, 0.4 to 0.75 m high; 116 faces."""
    height, shoots, twigs = rng.uniform(0.4, 0.75), 13, 16
    count = shoots + twigs
    azimuth = rng.uniform(0, 2 * np.pi, count)
    spread = 0.55 * height * np.sqrt(rng.random(count))
    foot = directions(azimuth) * spread[:, None] - 0.03 * UP
    share = np.where(np.arange(count) < shoots, 0.0, rng.uniform(0.25, 0.6, count))
    dome = np.sqrt(np.maximum(0.2, 1 - (spread / height) ** 2))
    foot += UP * (share * dome * height)[:, None]
    lean = 0.25 + 0.5 * spread / height + 0.8 * share
    axis = unit(UP + directions(azimuth + rng.normal(0, 0.7, count)) * lean[:, None])
    side = unit(np.cross(axis, rng.normal(0, 1, (count, 3))))
    length = height * dome * (1 - 0.75 * share) * rng.uniform(0.75, 1.1, count)
    cards = Cards(foot, axis, side, length, length * rng.uniform(0.75, 1.0, count))
    return strips(cards, 2, rng.uniform(0.0, 0.25, count), Layer.SCRUB, (0.5, 1.1))


def seedling(rng: np.random.Generator) -> Mesh:
    """A young broadleaved tree with a thin stem, 0.5 to 1 m high; at most 70 faces."""
    height, count = rng.uniform(0.5, 1.0), 12
    layer = (Layer.BEECH_LEAVES, Layer.MAPLE_LEAVES, Layer.BIRCH_LEAVES)[rng.integers(3)]
    share = np.linspace(0, 1, 4)
    bend = np.cumsum(rng.normal(0, 0.03, (4, 2)), 0) * share[:, None]
    curve = np.concatenate([bend, (share * (height + 0.05) - 0.05)[:, None]], -1)
    stem = tubes_mesh(curve[None], (0.006 * (1.2 - share))[None], 3, Layer.BEECH_SMOOTH, 0.6, 0.4)
    level = np.linspace(0.3, 1.0, count)
    foot = np.stack([np.interp(level, share, curve[:, axis]) for axis in range(3)], -1)
    azimuth = np.arange(count) * 2.4 + rng.normal(0, 0.4, count)
    axis = unit(directions(azimuth) + UP * rng.uniform(0.1, 0.6, (count, 1)))
    length = height * (0.55 - 0.3 * level) * rng.uniform(0.7, 1.2, count)
    across = directions(azimuth + np.pi / 2) + UP * rng.normal(0, 0.25, (count, 1))
    cards = Cards(foot, axis, unit(across), length, 0.9 * length)
    return merge([stem, strips(cards, 2, np.full(count, 0.3), layer, (0.8, 1.05))])


def herb(rng: np.random.Generator) -> Mesh:
    """A rosette of broad leaves on stalks, about 0.25 m high; 20 faces."""
    return _rosette(rng, 5, rng.uniform(0.2, 0.34), 0.9, 0.35, Layer.HERB)


def bilberry(rng: np.random.Generator) -> Mesh:
    """A dense dwarf shrub, about 0.3 m high; 24 faces."""
    return _rosette(rng, 6, rng.uniform(0.25, 0.4), 0.45, 0.1, Layer.BILBERRY)


def _rosette(
    rng: np.random.Generator, count: int, size_m: float, spread: float, droop: float, layer: Layer
) -> Mesh:
    """Cards that lean outwards in all directions."""
    azimuth = np.arange(count) * 2 * np.pi / count + rng.normal(0, 0.4, count)
    axis = unit(UP + directions(azimuth) * spread * rng.uniform(0.6, 1.4, (count, 1)))
    length = size_m * rng.uniform(0.75, 1.25, count)
    foot, side = 0.03 * directions(azimuth) - 0.02 * UP, directions(azimuth + np.pi / 2)
    cards = Cards(foot, axis, side, length, length * rng.uniform(0.9, 1.3, count))
    return strips(cards, 2, np.full(count, droop), layer, (0.45, 1.15))


def _tuft(rng: np.random.Generator, layer: Layer, size_m: float, lean: float) -> Mesh:
    """Three crossed cards of blades."""
    count = 3
    azimuth = np.arange(count) * 2 * np.pi / count + rng.normal(0, 0.3, count)
    foot = rng.normal(0, 0.035, (count, 3)) * [1, 1, 0] - 0.02 * UP
    axis = unit(UP + directions(rng.uniform(0, 2 * np.pi, count)) * lean)
    length = size_m * rng.uniform(0.75, 1.15, count)
    width = length * rng.uniform(0.9, 1.2, count)
    cards = Cards(foot, axis, directions(azimuth), length, width)
    return strips(cards, 2, rng.uniform(0.05, 0.35, count), layer, (0.45, 1.1))


def directions(azimuth_rad: Float) -> Float:
    """(n, 3) horizontal unit vectors of azimuths (n,)."""
    return np.stack([np.cos(azimuth_rad), np.sin(azimuth_rad), 0 * azimuth_rad], -1)


def strips(
    cards: Cards, segments: int, droop: Float, layer: int, tint: tuple[float, float]
) -> Mesh:
    """Make n bent cards of 2 * segments faces. Normals are bent up and away from the plant.

    Args:
        cards: The cards.
        segments: Segments along a card.
        droop: (n,) how far the tips hang below the straight line, as a fraction of the length.
        layer: Texture layer; u runs along a card, v across.
        tint: Brightness factors at foot and tip.
    """
    feet, axes, sides, length_m, width_m = cards
    share = np.linspace(0, 1, segments + 1)[:, None]
    straight = feet[:, None] + axes[:, None] * (length_m[:, None, None] * share)
    spine = straight - UP * ((droop * length_m)[:, None, None] * share**2)
    half = 0.5 * sides * width_m[:, None]
    vertices = np.stack([spine - half[:, None], spine + half[:, None]], 2)
    flat = unit(np.cross(np.gradient(spine, axis=1), sides[:, None]))
    flat = np.where(flat[..., 2:] < 0, -flat, flat)
    away = unit(vertices - np.array([0.0, 0.0, -0.3]))
    normals = unit(0.6 * flat[:, :, None] + 0.8 * away + 0.5 * UP)
    u, v = np.broadcast_arrays(share, np.array([0.0, 1.0]))
    count = len(feet)
    return make_mesh(
        vertices.reshape(-1, 3),
        normals.reshape(-1, 3),
        np.tile(np.stack([u, v], -1).reshape(-1, 2), (count, 1)),
        tube_faces(count, segments + 1, 1),
        layer,
        np.tile(np.interp(u.ravel(), [0, 1], tint), count),
    )
