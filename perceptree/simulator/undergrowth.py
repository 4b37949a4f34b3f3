"""What stands and lies between the trees: tufts, ferns, scrubs, dead branches, stumps."""

from __future__ import annotations

import numpy as np

from perceptree.simulator.mesh import UP, Mesh, cards_mesh, make_mesh, merge, tubes_mesh, unit
from perceptree.simulator.textures import Layer


def grass_tuft(rng: np.random.Generator) -> Mesh:
    """Three crossed upright cards, about 0.3 m high."""
    count = 3
    azimuth = np.arange(count) * 2 * np.pi / count + rng.normal(0, 0.3, count)
    foot = rng.normal(0, 0.04, (count, 3)) * [1, 1, 0]
    size = (0.34 * rng.uniform(0.7, 1.2, count))[:, None]
    along = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)], -1) * size * 0.5
    rise = (UP + rng.normal(0, 0.25, (count, 3)) * [1, 1, 0]) * size * 0.85
    corners = [foot - along, foot + along, foot + along + rise, foot - along + rise]
    faces = (np.arange(count)[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return make_mesh(
        np.stack(corners, 1).reshape(-1, 3),
        unit(UP + rng.normal(0, 0.25, (count * 4, 3))),
        np.tile([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]], (count, 1)),
        faces,
        Layer.GRASS,
        np.tile([0.35, 0.35, 1.1, 1.1], count),
    )


def fern(rng: np.random.Generator) -> Mesh:
    """Eight fronds in a rosette, about 0.6 m across."""
    return _rosette(rng, Layer.FERN, 8, 0.6, 0.75, 0.42, 0.02)


def scrub(rng: np.random.Generator) -> Mesh:
    """A low leafy bush, about 0.5 m high."""
    return _rosette(rng, Layer.LEAVES, 16, 0.5, 0.6, 0.75, 0.5)


def _rosette(
    rng: np.random.Generator, layer: Layer, count: int, size_m: float, rise: float, ratio: float,
    spread: float,
) -> Mesh:  # fmt: skip
    azimuth = np.arange(count) * 2 * np.pi / count + rng.normal(0, 0.3, count)
    axis = np.stack([np.cos(azimuth), np.sin(azimuth), rise + rng.normal(0, 0.15, count)], -1)
    side = np.stack([-np.sin(azimuth), np.cos(azimuth), rng.normal(0, 0.2, count)], -1)
    foot = UP * rng.uniform(0.0, spread, (count, 1)) * size_m
    length = size_m * rng.uniform(0.7, 1.2, count)
    centre = np.zeros((count, 3)) - 0.3 * UP
    return cards_mesh(
        foot, unit(axis), side, length, length * ratio, centre, layer, np.full(count, 0.85)
    )


def fallen_branch(rng: np.random.Generator) -> Mesh:
    """A branch on the ground, up to 2.8 m long, with side twigs."""
    twigs = int(rng.integers(0, 5))
    share = np.linspace(0, 1, 7)
    length = np.concatenate([rng.uniform(0.8, 2.8, 1), rng.uniform(0.2, 0.8, twigs)])
    turn = np.concatenate([[0.0], rng.choice([-1, 1], twigs) * rng.uniform(0.4, 1.0, twigs)])
    start = np.concatenate([[0.0], rng.uniform(0.2, 0.8, twigs) * length[0]])
    reach = length[:, None] * share
    lift = 0.03 + 0.12 * reach * rng.random((len(length), 1))
    curves = np.stack(
        [start[:, None] + np.cos(turn)[:, None] * reach, np.sin(turn)[:, None] * reach, lift], -1
    )
    curves = curves + np.cumsum(rng.normal(0, 0.012, curves.shape), 1)
    thickness = np.concatenate([rng.uniform(0.012, 0.05, 1), np.full(twigs, 0.008)])
    return tubes_mesh(curves, thickness[:, None] * (1 - 0.75 * share), 6, Layer.DEAD_WOOD, 0.9, 0.4)


def stump(rng: np.random.Generator) -> Mesh:
    """The foot of a felled tree with its cut face."""
    radius, height = rng.uniform(0.12, 0.28), rng.uniform(0.15, 0.6)
    level = np.array([-0.3, 0.0, 0.05, 0.12, 0.25, 0.5, 1.0]) * max(height, 0.2)
    curve = np.stack([0 * level, 0 * level, level], -1)[None]
    flare = 1 + 0.5 * np.exp(-np.maximum(level, 0) / 0.12)
    bark = tubes_mesh(curve, (radius * flare)[None], 20, Layer.FIR_BARK, 0.75, 0.7)
    angle = np.linspace(0, 2 * np.pi, 21)[:-1]
    rim = np.stack([np.cos(angle), np.sin(angle)], -1)
    top = np.concatenate([rim * radius * flare[-1], [[0.0, 0.0]]])
    vertices = np.concatenate([top, np.full((21, 1), level[-1])], -1)
    faces = np.stack([np.arange(20), (np.arange(20) + 1) % 20, np.full(20, 20)], -1)
    uv = np.concatenate([rim * 0.45 + 0.5, [[0.5, 0.5]]])
    normals = np.tile(UP, (21, 1))
    return merge([bark, make_mesh(vertices, normals, uv, faces, Layer.CUT_WOOD)])
