"""Meshes of dense grass and of hedge shrubs."""

from __future__ import annotations

from functools import partial

import numpy as np

from perceptree.simulator.geometry.mesh import Cards, Kind, Mesh, merge
from perceptree.simulator.geometry.plants import directions, strips
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.scene.vegetation import TUFT_ASPECTS
from perceptree.simulator.vectors import UP, unit

_GRASSES = {"green": (Layer.GRASS, 0.35), "dry": (Layer.DRY_GRASS, 0.6)}  # layer and lean


def grass_tuft(rng: np.random.Generator, layer: Layer, aspect: float, lean: float) -> Mesh:
    """A tuft of dense grass, 1 m high before it is scaled to its height; 12 faces.

    Args:
        rng: Source of random numbers.
        layer: Texture layer.
        aspect: Height over width.
        lean: Mean lean of the cards, as a slope.
    """
    count, width = 3, 1 / aspect
    azimuth = np.arange(count) * 2 * np.pi / count + rng.normal(0, 0.3, count)
    foot = rng.normal(0, 0.12 * width, (count, 3)) * [1, 1, 0] - 0.04 * UP
    slope = lean * rng.uniform(0.3, 1.7, (count, 1))
    axis = unit(UP + directions(rng.uniform(0, 2 * np.pi, count)) * slope)
    length = rng.uniform(0.95, 1.2, count)
    widths = width * rng.uniform(0.9, 1.2, count)
    cards = Cards(foot, axis, directions(azimuth), length, widths)
    return strips(cards, 2, rng.uniform(0.05, 0.25, count), layer, (0.4, 1.1))


def hedge_shrub(rng: np.random.Generator, layer: Layer) -> Mesh:
    """A dense leafy shrub, 1.2 m high and 0.9 m wide before it is scaled; 320 faces."""
    inner = _shell(rng, layer, 40, 0.45)
    outer = _shell(rng, layer, 120, 1.0)
    return merge([inner, outer])


def _shell(rng: np.random.Generator, layer: Layer, count: int, size: float) -> Mesh:
    """Leafy twigs that point outwards and upwards from the surface of a rounded column."""
    height = 1.05 * (np.arange(count) + rng.uniform(0, 1, count)) / count
    reach = 0.34 * size * np.sqrt(np.maximum(0.06, 1 - (height / 1.1) ** 4))
    outwards = directions(rng.uniform(0, 2 * np.pi, count))
    feet = outwards * (reach * rng.uniform(0.55, 1.0, count))[:, None] + UP * height[:, None]
    rise = 0.15 + 1.4 * (height / 1.1)[:, None] ** 3 + rng.normal(0, 0.35, (count, 1))
    axes = unit(outwards + UP * rise + 0.4 * rng.normal(0, 1, (count, 3)))
    sides = unit(np.cross(axes, rng.normal(0, 1, (count, 3))))
    length = rng.uniform(0.2, 0.34, count)
    feet -= 0.35 * axes * length[:, None]
    cards = Cards(feet, axes, sides, length, length * rng.uniform(0.8, 1.1, count))
    return strips(cards, 1, np.full(count, 0.12), layer, (0.5, 1.1))


VEGETATION: dict[str, Kind] = {
    f"{tone}_{shape}_tuft": Kind(partial(grass_tuft, layer=layer, aspect=aspect, lean=lean), 6)
    for tone, (layer, lean) in _GRASSES.items()
    for shape, aspect in TUFT_ASPECTS.items()
} | {
    "hedge_shrub": Kind(partial(hedge_shrub, layer=Layer.SCRUB), 4),
    "beech_hedge_shrub": Kind(partial(hedge_shrub, layer=Layer.BEECH_LEAVES), 4),
}
