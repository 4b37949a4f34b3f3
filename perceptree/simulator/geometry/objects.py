"""Meshes of objects that are not trees: people, animals, machines, posts, timber, walls, shapes.

Each function returns a mesh that stands on z = 0, with its front towards x.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from perceptree.simulator.geometry import debris
from perceptree.simulator.geometry.mesh import Kind, Mesh, merge
from perceptree.simulator.geometry.solids import ball, block, limb, painted
from perceptree.simulator.materials.layers import FIRST_GROUND, LAST_BARK, Layer

# Ranges of colour numbers in the layer PAINT, as in materials.manmade.
_SAFETY, _CLOTH, _SKIN, _METAL, _ANY = (0, 4), (4, 12), (12, 15), (15, 20), (0, 64)
_DARK = 18  # number of a dark colour
_SHAPE_LAYERS = (Layer.MASONRY, Layer.FUR, Layer.ROCK, Layer.DEAD_WOOD, Layer.MOSS, Layer.LITTER)


def _colour(rng: np.random.Generator, *groups: tuple[int, int]) -> int:
    first, last = groups[rng.integers(len(groups))]
    return int(rng.integers(first, last))


def person(rng: np.random.Generator) -> Mesh:
    """A standing, walking or stooping person of 1.5 to 1.95 m, often in safety colours."""
    tall = rng.uniform(1.5, 1.95)
    hip, shoulder, wide = 0.5 * tall, 0.82 * tall, 0.115 * tall
    bow = rng.choice([0.0, 0.0, rng.uniform(0.1, 0.6)]) * tall
    trousers, jacket = _colour(rng, _CLOTH, _SAFETY), _colour(rng, _CLOTH, _SAFETY, _ANY)
    stride = rng.uniform(-0.18, 0.18) * tall
    parts = []
    for side, step in ((1, stride), (-1, -stride)):
        foot = np.array([step, side * 0.06 * tall, 0.0])
        knee = np.array([step / 2 + 0.03, side * 0.06 * tall, 0.27 * tall])
        top = np.array([0, side * 0.05 * tall, hip])
        leg = limb([foot, knee, top], [0.045, 0.05, 0.07], 8)
        parts.append(painted(leg, trousers))
        boot = ball(foot + np.array([0.05, 0, 0.04]), (0.13, 0.05, 0.06))
        parts.append(painted(boot, _DARK))
        reach = rng.uniform(-0.2, 0.45) * tall
        hand = np.array([bow + reach, side * (wide + rng.uniform(0, 0.15)), shoulder - 0.36 * tall])
        joint = np.array([bow + reach / 3, side * (wide + 0.06), shoulder - 0.2 * tall])
        start = np.array([bow, side * wide, shoulder - 0.02])
        parts.append(painted(limb([start, joint, hand], [0.05, 0.042, 0.035], 7), jacket))
        parts.append(painted(ball(hand, (0.045, 0.04, 0.05)), _colour(rng, _SKIN, _CLOTH)))
    chest = [[0, 0, hip - 0.05], [bow / 2, 0, 0.66 * tall], [bow, 0, shoulder + 0.03]]
    parts.append(painted(limb(chest, [0.14, 0.15, 0.17], 12, flat=0.65), jacket))
    head = np.array([bow + 0.04 * bow, 0, 0.92 * tall])
    parts.append(painted(ball(head, (0.10, 0.08, 0.12)), _colour(rng, _SKIN)))
    hat = ball(head + np.array([0, 0, 0.06]), (0.12, 0.105, 0.085))
    parts.append(painted(hat, _colour(rng, _SAFETY, _CLOTH)))
    return merge(parts)


def animal(rng: np.random.Generator) -> Mesh:
    """A four-legged animal with a height of 0.35 to 1.35 m, such as a dog, boar, deer or cow."""
    back = rng.uniform(0.35, 1.35)
    long, deep = back * rng.uniform(0.95, 1.4), back * rng.uniform(0.16, 0.27)
    tint = float(rng.choice([0.12, 0.5, 0.8, 1.1, 1.6]))
    belly = back - deep
    parts = [ball([0, 0, belly], (long / 2, 0.7 * deep, deep))]
    for x in (-0.36, 0.36):
        for side in (-1, 1):
            hoof = [x * long + rng.uniform(-0.1, 0.1) * back, side * 0.4 * deep, 0.0]
            top = [x * long, side * 0.4 * deep, belly - 0.3 * deep]
            middle = np.mean([hoof, top], 0) + np.array([0.04 * back, 0, 0])
            parts.append(limb([hoof, middle, top], [0.03 * back, 0.045 * back, 0.4 * deep], 6))
    raised = rng.uniform(-0.5, 0.6) * back
    head = np.array([0.62 * long + 0.1 * back, rng.uniform(-0.15, 0.15), belly + raised])
    head[2] = max(head[2], 0.1)
    start = np.array([0.4 * long, 0, belly + 0.3 * deep])
    parts.append(limb([start, head], [0.6 * deep, 0.35 * deep], 8))
    parts.append(ball(head + np.array([0.1 * back, 0, 0]), (0.2 * back, 0.07 * back, 0.09 * back)))
    tail = np.array([-0.5 * long, 0, belly + 0.2 * deep])
    parts.append(
        limb([tail, tail + np.array([-0.1, 0, -0.3 * back])], [0.03 * back, 0.015 * back], 5)
    )
    mesh = merge([replace(part, layer=np.full_like(part.layer, Layer.FUR)) for part in parts])
    return replace(mesh, tint=mesh.tint * np.float32(tint))


def machine(rng: np.random.Generator) -> Mesh:
    """A forest machine with wheels, body, cabin and a jointed crane."""
    body, cabin = _colour(rng, _SAFETY, _METAL, _ANY), _colour(rng, _METAL)
    long, wide, low = rng.uniform(4.0, 7.0), rng.uniform(2.0, 2.8), rng.uniform(0.6, 0.9)
    parts = [painted(block([0, 0, low + 0.6], (long, 0.8 * wide, 1.2)), body)]
    cab_m = rng.uniform(-0.25, 0.25) * long
    parts.append(painted(block([cab_m, 0, low + 2.0], (1.7, 0.75 * wide, 1.7)), cabin))
    parts.append(painted(block([cab_m + 0.3, 0, low + 2.1], (1.3, 0.78 * wide, 1.0)), _DARK))
    for x in np.linspace(-0.4, 0.4, int(rng.integers(2, 5))) * long:
        for side in (-1, 1):
            hub = np.array([x, side * 0.5 * wide, low])
            half = np.array([0, 0.28, 0])
            parts.append(painted(limb([hub - half, hub + half], [low, low], 14), _DARK))
    joint, joints = np.array([0.3 * long, 0.0, low + 1.4]), []
    for reach, rise in ((0.6, 2.4), (2.8, rng.uniform(-0.3, 1.2)), (1.4, -rng.uniform(0.8, 2.0))):
        joints.append(joint)
        turn = rng.uniform(-0.5, 0.5)
        joint = joint + np.array([reach * np.cos(turn), reach * np.sin(turn), rise])
    joints.append(joint)
    parts.append(painted(limb(joints, [0.17, 0.15, 0.12, 0.10], 6), body))
    parts.append(painted(block(joint - [0, 0, 0.4], (0.6, 0.7, 1.0)), _DARK))
    return merge(parts)


def post(rng: np.random.Generator) -> Mesh:
    """A pole, a sign on a post, or a piece of fence."""
    form = rng.random()
    if form < 0.4:
        radius, high = rng.uniform(0.03, 0.14), rng.uniform(1.2, 9.0)
        pole = limb([[0, 0, -0.3], [0, 0, high]], [radius, 0.85 * radius], 12)
        return pole if rng.random() < 0.3 else painted(pole, _colour(rng, _METAL, _ANY))
    if form < 0.7:
        high, side = rng.uniform(1.0, 2.4), rng.uniform(0.25, 0.8)
        pole = painted(limb([[0, 0, -0.2], [0, 0, high]], [0.03, 0.03], 8), _colour(rng, _METAL))
        plate = block([0.04, 0, high - side / 2], (0.02, side, side * rng.uniform(0.5, 1.2)))
        return merge([pole, painted(plate, _colour(rng, _SAFETY, _METAL, _ANY))])
    step, high = rng.uniform(1.2, 2.5), rng.uniform(0.8, 1.6)
    posts = [
        limb([[0, y, -0.3], [0, y, high]], [0.05, 0.05], 7) for y in step * np.arange(-1.5, 2.0)
    ]
    rails = [
        limb([[0, -1.5 * step, z], [0, 1.5 * step, z]], [0.02, 0.02], 5)
        for z in high * np.linspace(0.3, 0.95, int(rng.integers(2, 5)))
    ]
    return merge([*posts, *rails])


def timber(rng: np.random.Generator) -> Mesh:
    """A long lying stem, a pile of logs, or a heap of branches."""
    form = rng.random()
    if form < 0.45:
        return lying_log(rng, rng.uniform(3.0, 9.0), rng.uniform(0.08, 0.24))
    if form < 0.8:
        long, radius, logs = rng.uniform(2.0, 4.5), rng.uniform(0.09, 0.18), []
        width = int(rng.integers(3, 7))
        for level in range(int(rng.integers(2, 5))):
            for column in range(max(1, width - level)):
                shift = [0, 2.05 * radius * (column - (width - level) / 2), 1.75 * radius * level]
                one = lying_log(rng, long * rng.uniform(0.93, 1.0), radius * rng.uniform(0.75, 1.0))
                logs.append(replace(one, vertices=one.vertices + np.array(shift)))
        return merge(logs)
    return merge([_tossed(rng, debris.fallen_branch(rng)) for _ in range(14)])


def _tossed(rng: np.random.Generator, branch: Mesh) -> Mesh:
    """Rotate, tilt and move a branch to a random pose in a heap."""
    azimuth, tilt = rng.uniform(0, 2 * np.pi), rng.normal(0, 0.25)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    turn = np.array([[1, 0, tilt], [0, 1, 0], [-tilt, 0, 1]])
    turn = turn @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    shift = np.array([*rng.normal(0, 0.35, 2), rng.uniform(0.05, 0.7)])
    return replace(branch, vertices=branch.vertices @ turn + shift, normals=branch.normals @ turn)


def lying_log(rng: np.random.Generator, long_m: float, radius_m: float) -> Mesh:
    """A lying log, scaled to a length and a radius."""
    mesh = debris.log(rng)
    span = np.ptp(mesh.vertices, axis=0)
    middle = (mesh.vertices.max(0) + mesh.vertices.min(0)) / 2
    size = np.array([long_m / span[0], 2 * radius_m / span[1], 2 * radius_m / span[2]])
    vertices = (mesh.vertices - middle) * size + [0, 0, 0.9 * radius_m]
    return replace(mesh, vertices=vertices.astype(np.float32))


def wall(rng: np.random.Generator) -> Mesh:
    """A stone wall, a boulder of up to 3 m, or a hut."""
    form = rng.random()
    if form < 0.4:
        long, high = rng.uniform(2.0, 7.0), rng.uniform(0.6, 1.8)
        return block([0, 0, high / 2 - 0.3], (0.4, long, high), Layer.MASONRY, 1.2)
    if form < 0.75:
        mesh = debris.rock(rng)
        grown = rng.uniform(1.2, 3.0) / np.ptp(mesh.vertices[:, 0])
        return replace(mesh, vertices=mesh.vertices * grown, uv=mesh.uv * grown)
    size = rng.uniform(2.0, 4.0, 3) * [1, 1, 0.7]
    body = block([0, 0, size[2] / 2 - 0.2], tuple(size), Layer.DEAD_WOOD, 1.0)
    roof = block([0, 0, size[2] - 0.1], (1.15 * size[0], 1.15 * size[1], 0.25))
    door = block([size[0] / 2, 0, 0.85], (0.06, 0.9, 1.9))
    return merge([body, painted(roof, _colour(rng, _ANY)), painted(door, _colour(rng, _ANY))])


def shape(rng: np.random.Generator) -> Mesh:
    """One to four solids of random shape, colour and texture; upright ones have no bark."""
    return merge([_solid(rng) for _ in range(int(rng.integers(1, 5)))])


def _solid(rng: np.random.Generator) -> Mesh:
    size = np.exp(rng.uniform(np.log(0.15), np.log(1.6), 3))
    centre = np.array([*rng.normal(0, 0.3, 2), rng.uniform(0.2, 1.0) * size[2]])
    form = rng.integers(3)
    lying = False
    if form == 0:
        mesh = block(centre, tuple(size), Layer.PAINT, 0.5)
    elif form == 1:
        mesh = ball(centre, tuple(size / 2))
    else:
        way = rng.normal(0, 1, 3)
        lying = abs(way[2]) < 0.5 * np.linalg.norm(way)
        half = way / np.linalg.norm(way) * size.max()
        ends = size.min() * rng.uniform(0.1, 0.5, 2)
        mesh = limb([centre - half, centre + half], [*ends], 12)
    if rng.random() < 0.6:
        return painted(mesh, _colour(rng, _ANY))
    barks = [Layer(number) for number in range(LAST_BARK + 1)]
    choice = [*_SHAPE_LAYERS, *barks] if lying else list(_SHAPE_LAYERS)
    layers = [layer for layer in choice if not FIRST_GROUND <= layer <= Layer.MUD]
    return replace(mesh, layer=np.full_like(mesh.layer, layers[rng.integers(len(layers))]))


OBJECTS: dict[str, Kind] = {
    "person": Kind(person, 10),
    "animal": Kind(animal, 10),
    "machine": Kind(machine, 4),
    "post": Kind(post, 10),
    "timber": Kind(timber, 10),
    "wall": Kind(wall, 8),
    "shape": Kind(shape, 24),
}
