"""Crown meshes: prototypes with a straight axis that are bent to the stem they are placed on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.geometry.habits import HABITS, Habit
from perceptree.simulator.geometry.mesh import Mesh, card_faces, make_mesh, merge, tubes_mesh
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.scene.models import TreeModel
from perceptree.simulator.scene.stem import Stem
from perceptree.simulator.vectors import UP, unit

CROWN_HEIGHT_M = 16.0  # height of the trees that crown prototypes are made for
_GOLDEN_RAD = 2.4  # golden angle between successive branches
_LOWEST_DEAD_M = 0.7  # height of the lowest dead branch
_SAPLING_M = (1.0, 3.0)  # range of the height of saplings
# Factors of the habit's parameters for crowns with fine twigs, and for distant crowns.
_FINE = {"twigs": 1.7, "twig_m": 0.68, "scatter": 1.6}
_FAR = {"branches": 0.40, "twigs": 0.45, "twig_m": 2.1}


def crown(
    rng: np.random.Generator, model: TreeModel, near: bool, leaves: bool = True, fine: bool = False
) -> Mesh:
    """Make the crown of a tree of 16 m height with a straight axis.

    Args:
        rng: Source of random numbers.
        model: The tree model.
        near: Whether to make full detail, with dead branches below the crown.
        leaves: Whether broadleaved trees have leaves, not bare twigs; conifers keep their needles.
        fine: Whether to make more and smaller twigs that spread more irregularly.
    """
    habit = HABITS[model.species]
    if fine:
        habit = _finer(habit)
    if not leaves and not model.conifer:
        habit = replace(habit, foliage=Layer.BARE_TWIG, twigs=habit.twigs // 2)
    base_m = rng.uniform(*model.crown_base) * CROWN_HEIGHT_M
    if not near:
        return merge(_branches_and_twigs(rng, _coarse(habit), base_m, 2))
    parts = _branches_and_twigs(rng, habit, base_m, 5 if habit.forks else 4)
    return merge(parts + _dead_branches(rng, model.dead_branches, base_m))


def sapling(rng: np.random.Generator, species: str) -> Mesh:
    """Make a young conifer of 1 to 3 m height with branches to the ground; it has no label."""
    habit = HABITS[species]
    small = replace(
        habit,
        branches=30,
        twigs=4,
        forks=0,
        bare=0.1,
        reach_m=1.45 * habit.reach_m,
        widest=0.05,
        twig_m=(2.2, 2.0),
        pointed=0.9,
        wood_m=2 * habit.wood_m,
    )
    height = np.linspace(-0.8, CROWN_HEIGHT_M, 4)
    axis = np.stack([0 * height, 0 * height, height], -1)[None]
    radius = 0.22 * (1.02 - np.maximum(height, 0) / CROWN_HEIGHT_M)[None]
    stem = tubes_mesh(axis, radius, 5, habit.wood, 0.9, 3.0)
    full_size = merge([stem, *_branches_and_twigs(rng, small, 0.9, 3)])
    size = rng.uniform(*_SAPLING_M) / CROWN_HEIGHT_M
    return replace(full_size, vertices=full_size.vertices * np.float32(size))


def fit_crown(crown: Mesh, stem: Stem, turn_rad: float, tint: float) -> Mesh:
    """Rotate a crown prototype, scale it to the stem's height and bend it along the stem's axis.

    Args:
        crown: The prototype.
        stem: The stem.
        turn_rad: Rotation about the vertical.
        tint: Brightness factor.
    """
    scale = stem.height_m / CROWN_HEIGHT_M
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    vertices = (crown.vertices @ turn) * scale
    bent = stem.axis(vertices[:, 2])
    vertices[:, :2] += bent[:, :2]
    return Mesh(
        vertices,
        crown.normals @ turn,
        crown.uv,
        crown.tint * tint,
        crown.faces,
        crown.layer,
        crown.labelled,
    )


def _finer(habit: Habit) -> Habit:
    return replace(
        habit,
        twigs=round(habit.twigs * _FINE["twigs"]),
        twig_m=(habit.twig_m[0] * _FINE["twig_m"], habit.twig_m[1] * _FINE["twig_m"]),
        roll_rad=habit.roll_rad * _FINE["scatter"],
        irregular=habit.irregular * _FINE["scatter"],
    )


def _coarse(habit: Habit) -> Habit:
    """The crown for distant trees: fewer branches, fewer and larger twigs."""
    return replace(
        habit,
        branches=round(habit.branches * _FAR["branches"]),
        forks=min(habit.forks, 1),
        twigs=round(habit.twigs * _FAR["twigs"]),
        twig_m=(habit.twig_m[0] * _FAR["twig_m"], habit.twig_m[1] * _FAR["twig_m"]),
    )


def _branches_and_twigs(
    rng: np.random.Generator, habit: Habit, base_m: float, knots: int
) -> list[Mesh]:
    """Make branches, their side branches, and twigs on all of them.

    Branches are curves of `knots` points. With 2 knots (distant trees), wood that needles hide
    is left out.
    """
    count = habit.branches
    share = (np.arange(count) + rng.uniform(-0.4, 0.4, count)) / count
    share = np.clip(share, 0.0, 0.99)
    below = np.clip(0.65 + 0.35 * share / habit.widest, 0, 1)
    above = np.clip((1 - share) / (1 - habit.widest), 0, 1) ** habit.pointed
    length_m = 0.25 + habit.reach_m * np.minimum(below, above)
    length_m = length_m * np.exp(rng.normal(0, habit.irregular, count))
    rise = habit.rise[0] + (habit.rise[1] - habit.rise[0]) * share + rng.normal(0, 0.1, count)
    foot = UP * (base_m + (0.985 * CROWN_HEIGHT_M - base_m) * share)[:, None]
    azimuth = _GOLDEN_RAD * np.arange(count) + rng.normal(0, 0.35, count)
    curves = _curves(rng, habit, foot, azimuth, length_m, rise, knots)
    parts = [_twigs(rng, habit, curves, length_m)]
    if knots > 2 or habit.forks:
        parts.append(_wood(habit, curves, length_m))
    if habit.forks:
        parts += _side_branches(rng, habit, curves, azimuth, length_m, rise)
    return parts


def _side_branches(
    rng: np.random.Generator,
    habit: Habit,
    curves: Float,
    azimuth: Float,
    length_m: Float,
    rise: Float,
) -> list[Mesh]:
    shape = (len(curves), habit.forks)
    share = (np.arange(habit.forks) + rng.uniform(0.2, 0.8, shape)) / habit.forks
    share = 0.2 + 0.65 * share
    side = np.where((np.arange(habit.forks) + np.arange(len(curves))[:, None]) % 2, -1.0, 1.0)
    side_azimuth = azimuth[:, None] + side * rng.uniform(0.5, 1.0, shape)
    reach_m = length_m[:, None] * (1.05 - share) * rng.uniform(0.5, 0.8, shape)
    slope = 0.7 * rise[:, None] + rng.normal(0, 0.15, shape)
    side_curves = _curves(
        rng,
        habit,
        _along(curves, share).reshape(-1, 3),
        side_azimuth.ravel(),
        reach_m.ravel(),
        slope.ravel(),
        min(3, curves.shape[1]),
    )
    return [
        _wood(habit, side_curves, reach_m.ravel()),
        _twigs(rng, habit, side_curves, reach_m.ravel()),
    ]


def _curves(
    rng: np.random.Generator,
    habit: Habit,
    foot: Float,
    azimuth: Float,
    length_m: Float,
    rise: Float,
    knots: int,
) -> Float:
    """(n, knots, 3) curves of branches from their feet (n, 3) outwards, m."""
    share = np.linspace(0, 1, knots)
    slope = rise[:, None] * share - habit.droop * share**2 + habit.lift * share**3
    out = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))], -1)
    path = out[:, None] * share[:, None] + UP * slope[..., None]
    path = path / np.maximum(1.0, np.hypot(1.0, rise))[:, None, None]
    wobble = rng.normal(0, 0.04, path.shape) * share[:, None]
    return foot[:, None] + (path + wobble) * length_m[:, None, None]


def _wood(habit: Habit, curves: Float, length_m: Float) -> Mesh:
    share = np.linspace(0, 1, curves.shape[1])
    radius_m = (habit.wood_m * np.sqrt(length_m))[:, None] * (1 - 0.85 * share)
    return tubes_mesh(curves, radius_m, 3, habit.wood, 0.7, 0.5)


def _along(curves: Float, share: Float) -> Float:
    """(n, m, 3) points on curves (n, K, 3) at fractions (n, m) of their length."""
    position = share * (curves.shape[1] - 1)
    knot = np.minimum(position.astype(int), curves.shape[1] - 2)
    rest = (position - knot)[..., None]
    branch = np.arange(len(curves))[:, None]
    return np.asarray(curves[branch, knot] * (1 - rest) + curves[branch, knot + 1] * rest)


def _twigs(rng: np.random.Generator, habit: Habit, curves: Float, length_m: Float) -> Mesh:
    """Twig cards alternately on both sides of the branches, and one at the end of each branch."""
    shape = (len(curves), habit.twigs)
    order = np.arange(habit.twigs)
    share = habit.bare + (0.97 - habit.bare) * (order + rng.uniform(0, 0.9, shape)) / habit.twigs
    share[:, -1] = 0.9
    way = _along(curves, np.minimum(share + 0.1, 1.0)) - _along(curves, share - 0.1)
    fan = np.where(order % 2, 1.0, -1.0) * habit.fan_rad * rng.uniform(0.6, 1.3, shape)
    fan[:, -1] = 0.0
    azimuth = np.arctan2(way[..., 1], way[..., 0]) + fan
    slope = habit.hang + rng.normal(0, 0.15, shape) + 0.5 * np.clip(unit(way)[..., 2], -1, 0.6)
    axis = unit(np.stack([np.cos(azimuth), np.sin(azimuth), slope], -1))
    first, last = habit.twig_m
    young = np.minimum(1.0, 0.35 + 0.3 * length_m)[:, None]
    size_m = (first + (last - first) * share) * young * rng.uniform(0.8, 1.2, shape)
    tint = np.clip(0.5 + 0.6 * share, 0, 1.1) * rng.uniform(0.82, 1.15, shape)
    return _cards(
        habit,
        _along(curves, share).reshape(-1, 3),
        axis.reshape(-1, 3),
        rng.normal(0, habit.roll_rad, shape).ravel(),
        size_m.ravel(),
        tint.ravel(),
    )


def _cards(
    habit: Habit, origins: Float, axes: Float, roll_rad: Float, length_m: Float, tint: Float
) -> Mesh:
    """Twigs as n strips folded along their middle, of 6 vertices and 4 triangles each.

    Normals are bent away from the stem's axis, so that the shading of the foliage shows volume.
    """
    level = unit(np.cross(UP, axes))
    above = np.cross(axes, level)
    side = np.cos(roll_rad)[:, None] * level + np.sin(roll_rad)[:, None] * above
    ridge = np.cross(axes, side)
    half_m = (0.5 * habit.ratio * length_m)[:, None]
    spine = np.stack([origins, origins + axes * length_m[:, None]], 1)
    wings = np.stack([-side, 0 * side, side], 1)
    folded = wings + habit.fold * np.array([[-0.5], [0.5], [-0.5]]) * ridge[:, None]
    vertices = spine[:, :, None] + (half_m[:, None] * folded)[:, None]
    upper = np.where(ridge[:, 2:] < 0, -ridge, ridge)[:, None] + 0.6 * habit.fold * wings
    away = vertices - (origins * [0.0, 0.0, 1.0] - 0.5 * UP)[:, None, None]
    corners = [(along, across) for along in (0.0, 1.0) for across in (0.0, 0.5, 1.0)]
    return make_mesh(
        vertices.reshape(-1, 3),
        unit(upper[:, None] + 0.9 * unit(away)).reshape(-1, 3),
        np.tile(corners, (len(origins), 1)),
        card_faces(len(origins), 6, [[0, 3, 4, 1], [1, 4, 5, 2]]),
        habit.foliage,
        np.repeat(tint, 6),
    )


def dead_twigs(rng: np.random.Generator, count: int) -> Mesh:
    """Make thin dead twigs, most of them bare, around the lower stem of a tree of 16 m height.

    Args:
        rng: Source of random numbers.
        count: Number of twigs.
    """
    dry = HABITS["dead_twig"]
    height_m = np.sort(rng.uniform(0.4, 7.0, count))
    length_m = 0.12 + 0.9 * rng.random(count) ** 1.5
    azimuth = rng.uniform(0, 2 * np.pi, count)
    curves = _curves(
        rng, dry, UP * height_m[:, None], azimuth, length_m, rng.normal(0.0, 0.2, count), 3
    )
    twiggy = rng.random(count) < 0.35
    return merge([_wood(dry, curves, length_m), _twigs(rng, dry, curves[twiggy], length_m[twiggy])])


def _dead_branches(rng: np.random.Generator, count: int, base_m: float) -> list[Mesh]:
    """Dead branches below the crown, most of them broken short, some with bare twigs."""
    if not count:
        return []
    dead = HABITS["dead_branch"]
    height_m = np.sort(rng.uniform(_LOWEST_DEAD_M, base_m + 0.6, count))
    length_m = 0.28 + 1.3 * rng.random(count) ** 1.7 * np.clip(height_m / base_m, 0.45, 1.0)
    azimuth = _GOLDEN_RAD * np.arange(count) + rng.normal(0, 0.5, count)
    curves = _curves(
        rng, dead, UP * height_m[:, None], azimuth, length_m, rng.normal(-0.02, 0.15, count), 4
    )
    long = length_m > 0.6
    return [_wood(dead, curves, length_m), _twigs(rng, dead, curves[long], length_m[long])]
