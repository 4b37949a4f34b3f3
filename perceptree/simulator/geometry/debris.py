"""Meshes of dead branches, logs, stumps, rocks and roots on the ground.

Each function returns a mesh that is placed on z = 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float
from perceptree.simulator.geometry.mesh import (
    Cards,
    Mesh,
    cards_mesh,
    make_mesh,
    merge,
    surface_mesh,
    tube_faces,
    tubes_mesh,
)
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.vectors import UP, heading, unit

_BARKS = (
    Layer.SPRUCE_GREY,
    Layer.FIR_MOSSY,
    Layer.PINE_PLATED,
    Layer.SPRUCE_LICHEN,
    Layer.BEECH_MOSSY,
    Layer.BIRCH_WHITE,
    Layer.MAPLE_MOSSY,
)
_ROOT_BARKS = (Layer.SPRUCE_SCALY, Layer.SPRUCE_GREY, Layer.FIR_RESIN)
_ROTTEN = 0.3  # fraction of rotten stumps
# Cumulative fractions of fallen branches: with needles, twig litter, with bark; the rest is bare.
_BRUSHY, _LITTER, _BARKED = 0.25, 0.45, 0.65


def fallen_branch(rng: np.random.Generator) -> Mesh:
    """A dead branch of up to 2.8 m, bare, with bark or with dry needles; or a few twigs."""
    form = rng.random()
    if _BRUSHY <= form < _LITTER:
        return twig_litter(rng)
    layer = _bark(rng) if form < _BARKED else Layer.DEAD_WOOD
    wood = _branch(rng, 2 if form < _BRUSHY else int(rng.integers(1, 5)), layer)
    return merge([wood, _dry_needles(rng, wood)]) if form < _BRUSHY else wood


def twig_litter(rng: np.random.Generator) -> Mesh:
    """Thin sticks scattered over about 1 m."""
    count = 11
    centre = rng.normal(0, 0.28, (count, 1, 2))
    turn, length = rng.uniform(0, 2 * np.pi, count), rng.uniform(0.12, 0.6, count)
    along = heading(turn) * length[:, None]
    level = centre + along[:, None] * np.linspace(-0.5, 0.5, 3)[:, None]
    level = level + rng.normal(0, 0.06, (count, 3, 1)) * along[:, None, ::-1] * [1, -1]
    curves = np.concatenate([level, rng.uniform(0.0, 0.03, (count, 3, 1))], -1)
    radius = rng.uniform(0.003, 0.009, (count, 1)) * np.linspace(1, 0.5, 3)
    return tubes_mesh(curves, radius, 3, Layer.DEAD_WOOD, rng.uniform(0.6, 1.0), 0.4)


def log(rng: np.random.Generator) -> Mesh:
    """A lying log of 11 to 21 cm diameter with cut ends and branch stubs."""
    length, radius, rings = rng.uniform(1.2, 3.2), rng.uniform(0.055, 0.105), 6
    share = np.linspace(0, 1, rings)
    sideways = np.cumsum(rng.normal(0, 0.015 * length, rings))
    rise = 0.6 * radius + rng.normal(0, 0.008, rings)
    centres = np.stack([(share - 0.5) * length, sideways, rise], -1)
    thickness = radius * (1.1 - 0.3 * share)
    sides, layer = 10, _bark(rng) if rng.random() < 0.75 else Layer.DEAD_WOOD
    tint = rng.uniform(0.6, 0.95)
    bark = tubes_mesh(centres[None], thickness[None], sides, layer, tint, 0.6)
    grid = bark.vertices.reshape(rings, sides + 1, 3)
    fresh = rng.uniform(0.2, 0.75)
    along = centres[-1] - centres[0]
    ends = [_cap(grid[0, :-1], -along, fresh), _cap(grid[-1, :-1], along, fresh)]
    reach = np.linspace(0, 1, 2)[:, None] * rng.uniform(1.3, 2.2)
    angle = rng.uniform(0.1, np.pi - 0.1, (2, 1, 1))
    out = np.concatenate([0.3 + 0 * angle, np.cos(angle), np.sin(angle)], -1)
    curves = centres[rng.integers(1, rings - 1, 2)][:, None] + out * reach * radius
    snags = tubes_mesh(curves, np.tile([0.22 * radius, 0.12 * radius], (2, 1)), 4, layer, tint, 0.4)
    return merge([bark, *ends, snags])


def stump(rng: np.random.Generator) -> Mesh:
    """A stump with root flare and cut face, or a rotten one with a torn top."""
    rotten, sides = rng.random() < _ROTTEN, 18
    radius, height = rng.uniform(0.10, 0.26), rng.uniform(0.15, 0.6)
    level = np.array([-0.5, -0.06, 0.04, 0.12, 0.45, 1.0])
    level = np.where(level > 0, level * max(height, 0.15), level)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    lobes = 0.5 + 0.5 * np.cos(angle * rng.integers(3, 6) + rng.uniform(0, 6))
    lobes = lobes + 0.3 * np.cos(angle + rng.uniform(0, 6))
    flare = np.exp(-np.maximum(level, -0.06)[:, None] / 0.11) * (0.10 + 0.30 * lobes)
    oval = 1 + 0.06 * np.cos(2 * angle + rng.uniform(0, 6))
    reach = radius * (oval + flare)
    grid = np.stack(
        np.broadcast_arrays(reach * np.cos(angle), reach * np.sin(angle), level[:, None]), -1
    )
    torn = rng.normal(0, 0.15 if rotten else 0.006, sides + 1) * height
    torn[-1] = torn[0]
    slope = rng.normal(0, 0.06, 2) if not rotten else np.zeros(2)
    top = torn + (grid[-1, :, :2] * slope).sum(-1)
    grid[-1, :, 2] += np.maximum(top, -0.4 * height)
    layer = Layer.DEAD_WOOD if rotten else _bark(rng)
    centres = np.stack([0 * level, 0 * level, level], -1)
    repeats = max(1, round(2 * np.pi * radius / 0.5))
    bark = surface_mesh(grid[None], centres[None], layer, repeats, 0.6, rng.uniform(0.55, 0.9))
    return merge(
        [
            bark,
            _hollow(grid[-1, :-1], height)
            if rotten
            else _cap(grid[-1, :-1], UP, rng.uniform(0.2, 0.75)),
        ]
    )


def rock(rng: np.random.Generator) -> Mesh:
    """A boulder of 0.15 to 0.9 m with flat sides and rounded edges, its lower half buried."""
    columns, rings = 14, 8
    azimuth = np.linspace(0, 2 * np.pi, columns + 1)[:-1]
    polar = np.linspace(0, 0.78 * np.pi, rings)[1:]
    ring = np.stack(
        np.broadcast_arrays(
            np.sin(polar)[:, None] * np.cos(azimuth),
            np.sin(polar)[:, None] * np.sin(azimuth),
            np.cos(polar)[:, None],
        ),
        -1,
    )
    towards = np.concatenate([UP[None], ring.reshape(-1, 3)])
    normals = unit(rng.normal(0, 1, (13, 3)))
    gap = rng.uniform(0.55, 1.0, 13)
    facing = np.maximum(towards @ normals.T, 0) / gap
    nearest = (facing**16).sum(-1) ** (1 / 16)
    reach = 1 / np.maximum(nearest, 0.77) * (1 + rng.normal(0, 0.015, len(nearest)))
    half = 0.5 * np.exp(rng.uniform(np.log(0.18), np.log(0.9)))
    stretch = half * np.array(
        [rng.uniform(0.9, 1.15), rng.uniform(0.7, 1.0), rng.uniform(0.55, 0.85)]
    )
    vertices = towards * reach[:, None] * stretch
    vertices[-columns:, 2] = np.minimum(vertices[-columns:, 2], -0.12)
    index = 1 + np.arange((rings - 1) * columns).reshape(rings - 1, columns)
    after = np.roll(index, -1, 1)
    fan = np.stack([np.zeros_like(index[0]), index[0], after[0]], -1)
    first = np.stack([index[:-1], index[1:], after[1:]], -1).reshape(-1, 3)
    second = np.stack([index[:-1], after[1:], after[:-1]], -1).reshape(-1, 3)
    faces = np.concatenate([fan, first, second])
    bearing = towards[:, :2] / np.maximum(1e-6, np.linalg.norm(towards[:, :2], axis=-1))[:, None]
    uv = bearing * np.arccos(np.clip(towards[:, 2], -1, 1))[:, None] * half / 0.6
    return make_mesh(
        vertices,
        _smooth_normals(vertices, faces),
        uv + rng.random(2),
        faces,
        Layer.ROCK,
        rng.uniform(0.6, 0.95),
    )


def surface_roots(rng: np.random.Generator) -> Mesh:
    """Half-buried winding roots of 0.6 to 1.7 m around a stem's foot."""
    count, segments = int(rng.integers(4, 8)), 7
    share = np.linspace(0, 1, segments + 1)
    azimuth = np.arange(count) * 2 * np.pi / count + rng.normal(0, 0.3, count)
    length = np.exp(rng.uniform(np.log(0.6), np.log(1.7), count))
    turn = azimuth[:, None] + np.cumsum(rng.normal(0, 0.32, (count, segments)), 1)
    steps = heading(turn) * (length / segments)[:, None, None]
    start = 0.05 * heading(azimuth)[:, None]
    path = np.concatenate([start, start + np.cumsum(steps, 1)], 1)
    radius = rng.uniform(0.02, 0.06, (count, 1)) * (1 - 0.75 * share)
    radius[:, 0] *= 1.5
    lift = radius * (rng.uniform(-0.2, 0.6, radius.shape) - 0.6 * share**2)
    lift[:, 0], lift[:, -1] = 0.5 * radius[:, 0], -1.2 * radius[:, -1]
    curves = np.concatenate([path, lift[..., None]], -1)
    tangent = unit(np.gradient(path, axis=1))
    side = np.stack([-tangent[..., 1], tangent[..., 0], 0 * tangent[..., 0]], -1)
    profile = np.array([[1.1, -3.0], [0.55, 0.75], [-0.55, 0.75], [-1.1, -3.0]])
    across = side[:, :, None] * profile[:, :1] + UP * profile[:, 1:]
    vertices = curves[:, :, None] + across * radius[..., None, None]
    outwards = unit(side[:, :, None] * profile[:, :1] + UP * [[0.25], [0.72], [0.72], [0.25]])
    along = (length[:, None] * share / 0.5)[..., None]
    uv = np.stack(np.broadcast_arrays(np.linspace(0, 0.5, 4), along), -1)
    return make_mesh(
        vertices.reshape(-1, 3),
        outwards.reshape(-1, 3),
        uv.reshape(-1, 2),
        tube_faces(count, segments + 1, 3),
        _ROOT_BARKS[rng.integers(len(_ROOT_BARKS))],
        rng.uniform(0.4, 0.6),
    )


def _bark(rng: np.random.Generator) -> Layer:
    return _BARKS[rng.integers(len(_BARKS))]


def _branch(rng: np.random.Generator, twigs: int, layer: int) -> Mesh:
    """A crooked branch with side twigs in the plane of the ground."""
    length = rng.uniform(0.8, 2.8)
    main = _crooked(rng, np.zeros((1, 2)), np.zeros(1), np.array([length]), 7)
    thickness = rng.uniform(0.010, 0.032) * (1 - 0.75 * np.linspace(0, 1, 7))
    tint = rng.uniform(0.55, 0.95)
    wood = tubes_mesh(main - [0.5 * length, 0, 0], thickness[None], 5, layer, tint, 0.4)
    at = rng.integers(1, 6, twigs)
    turn = rng.choice([-1, 1], twigs) * rng.uniform(0.4, 1.0, twigs)
    side = _crooked(rng, main[0, at, :2], turn, rng.uniform(0.25, 0.8, twigs), 4)
    side[..., 2] += (main[0, at, 2] - side[:, 0, 2])[:, None]
    fine = 0.45 * thickness[at][:, None] * (1 - 0.7 * np.linspace(0, 1, 4))
    return merge([wood, tubes_mesh(side - [0.5 * length, 0, 0], fine, 3, layer, tint, 0.4)])


def _crooked(
    rng: np.random.Generator, start: Float, turn_rad: Float, length_m: Float, points: int
) -> Float:
    """(n, points, 3) bent curves from `start` (n, 2), rising slightly above the ground, m."""
    reach = length_m[:, None] * np.linspace(0, 1, points)
    level = np.stack([np.cos(turn_rad)[:, None] * reach, np.sin(turn_rad)[:, None] * reach], -1)
    bend = np.cumsum(rng.normal(0, 0.03, level.shape) * length_m[:, None, None] / 2, 1)
    lift = 0.02 + 0.10 * reach * rng.random((len(length_m), 1))
    return np.concatenate([start[:, None] + level + bend, lift[..., None]], -1)


def _dry_needles(rng: np.random.Generator, wood: Mesh) -> Mesh:
    """Twigs with needles along the outer half of a branch."""
    count = 6
    reach = wood.vertices[:, 0].max()
    x = rng.uniform(-0.2, 0.8, count) * reach
    nearest = np.abs(wood.vertices[:, 0] - x[:, None]).argmin(1)
    origins = np.asarray(wood.vertices[nearest], np.float64)
    turn = np.resize([-1.0, 1.0], count) * rng.uniform(0.4, 1.0, count)
    axes = np.stack([np.cos(turn), np.sin(turn), rng.uniform(0.05, 0.3, count)], -1)
    sides = np.stack([-np.sin(turn), np.cos(turn), rng.normal(0, 0.3, count)], -1)
    size = rng.uniform(0.25, 0.5, count)
    layer = (Layer.FIR_TWIG, Layer.SPRUCE_TWIG, Layer.PINE_TWIG, Layer.BARE_TWIG)[rng.integers(4)]
    cards = Cards(origins, unit(axes), unit(sides), size, 0.7 * size)
    tint = np.full(count, rng.uniform(0.6, 0.95))
    return cards_mesh(cards, origins - UP, layer, tint, 0.15)


def _cap(rim: Float, outwards: Float, tint: float) -> Mesh:
    """A cut face with centred growth rings inside a rim (n, 3), facing `outwards` (3,)."""
    centre, count = rim.mean(0), len(rim)
    first = unit(rim[0] - centre)
    normal = unit(np.cross(first, rim[count // 4] - centre))
    flat = np.stack([(rim - centre) @ first, (rim - centre) @ np.cross(normal, first)], -1)
    uv = np.concatenate([0.5 + 0.47 * flat / np.linalg.norm(flat, axis=-1).max(), [[0.5, 0.5]]])
    number = np.arange(count)
    return make_mesh(
        np.concatenate([rim, centre[None]]),
        np.tile(normal * np.sign(normal @ outwards), (count + 1, 1)),
        uv,
        np.stack([number, (number + 1) % count, np.full(count, count)], -1),
        Layer.CUT_WOOD,
        tint,
    )


def _hollow(rim: Float, height_m: float) -> Mesh:
    """The rotten inside of a stump: dark wood that descends from the rim to the centre."""
    centre = rim.mean(0)
    inner = centre + (rim - centre) * 0.6
    inner[:, 2] = rim[:, 2] - 0.25 * height_m
    middle = centre - [0, 0, 0.45 * height_m]
    vertices = np.concatenate([rim, inner, middle[None]])
    count = len(rim)
    number = np.arange(count)
    after = (number + 1) % count
    faces = np.concatenate(
        [
            np.stack([number, after, count + after], -1),
            np.stack([number, count + after, count + number], -1),
            np.stack([count + number, count + after, np.full(count, 2 * count)], -1),
        ]
    )
    tint = np.concatenate([np.full(count, 0.8), np.full(count, 0.4), [0.25]])
    uv = vertices[:, [0, 2]] + vertices[:, [1, 1]]
    return make_mesh(
        vertices, _smooth_normals(vertices, faces), uv / 0.5, faces, Layer.DEAD_WOOD, tint
    )


def _smooth_normals(vertices: Float, faces: NDArray[np.integer[Any]]) -> Float:
    """(V, 3) area-weighted mean of the normals of the faces at each vertex."""
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    flat = np.cross(second - first, third - first)
    total = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(total, faces[:, corner], flat)
    return unit(total)
