"""Meshes of what is mistaken for stems near a camera: legs, posts, dead wood, stumps, twigs.

Each function returns a mesh that stands on z = 0, with its front or length along x. What stands
upright wears no bark, except for low stumps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from perceptree.simulator.geometry import debris
from perceptree.simulator.geometry.mesh import Cards, Kind, Mesh, cards_mesh, merge, tubes_mesh
from perceptree.simulator.geometry.objects import lying_log
from perceptree.simulator.geometry.solids import ball, block, limb, painted
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.vectors import UP, unit

_Coat = Callable[[Mesh], Mesh]

LOG_M = 6.0  # length of a log before it is scaled
TWIG_M = 0.8  # length of a twig at the lens before it is scaled
_PAINTS = 64
_DARK, _WHITE, _MOSS = 18, 15, 19  # numbers of colours in the layer PAINT
_SKIN = (12, 15)
_WEAVES = (Layer.FUR, Layer.ROCK)  # layers that pass for cloth
_POST_LAYERS = (Layer.DEAD_WOOD, Layer.DEAD_WOOD, Layer.CUT_WOOD, Layer.MASONRY, Layer.ROCK)
_LEAVES = (
    Layer.BEECH_LEAVES,
    Layer.BIRCH_LEAVES,
    Layer.MAPLE_LEAVES,
    Layer.FIR_TWIG,
    Layer.SPRUCE_TWIG,
    Layer.BARE_TWIG,
    Layer.BARE_TWIG,
)
_STUMP_M = 0.9
_SUNK_M = 0.05  # depth of a limb's lowest point in the ground


def _clad(mesh: Mesh, layer: int, tint: float) -> Mesh:
    """Give a mesh another texture and brightness."""
    return replace(mesh, layer=np.full_like(mesh.layer, layer), tint=mesh.tint * np.float32(tint))


def _cloth(rng: np.random.Generator) -> _Coat:
    """Cloth of plain colour or of a woven texture."""
    if rng.random() < 0.6:
        return partial(painted, colour=int(rng.integers(_PAINTS)))
    layer = _WEAVES[rng.integers(len(_WEAVES))]
    return partial(_clad, layer=layer, tint=float(rng.uniform(0.3, 1.6)))


def walker(rng: np.random.Generator) -> Mesh:
    """A person of 1.5 to 1.95 m with full legs, in boots and trousers or shorts."""
    tall, stout = rng.uniform(1.5, 1.95), rng.uniform(0.85, 1.25)
    trousers, jacket, skin = _cloth(rng), _cloth(rng), int(rng.integers(*_SKIN))
    if rng.random() < 0.15:
        trousers = partial(painted, colour=skin)
    stride, apart = rng.uniform(-0.2, 0.2) * tall, rng.uniform(0.05, 0.12) * tall
    boot_m, parts = float(rng.choice([0.08, 0.12, 0.35])), []
    for side, step in ((1, stride), (-1, -stride)):
        foot = np.array([step, side * apart, 0.03])
        knee = np.array([0.55 * step + 0.04, side * apart, 0.27 * tall])
        hip = np.array([0.0, side * 0.055 * tall, 0.5 * tall])
        radii = stout * np.array([0.045, 0.065, 0.058, 0.08, 0.09]) * rng.uniform(0.95, 1.1, 5)
        path = [foot, (2 * knee + foot) / 3, knee, (knee + hip) / 2, hip]
        parts.append(trousers(limb(path, radii, 10)))
        shaft = foot + (knee - foot) * boot_m / knee[2]
        parts.append(painted(limb([foot, shaft], [0.055 * stout, 0.07 * stout], 9), _DARK))
        parts.append(painted(ball(np.add(foot, [0.06, 0, 0.01]), (0.14, 0.05, 0.06)), _DARK))
        reach, low = rng.uniform(-0.2, 0.4), rng.uniform(0.42, 0.6)
        elbow = [0.03, side * 0.14 * tall, 0.64 * tall]
        hand = [reach, side * 0.14 * tall, low * tall]
        arm = [[0, side * 0.085 * tall, 0.81 * tall], elbow, hand]
        parts.append(jacket(limb(arm, [0.06, 0.05, 0.04], 8)))
        parts.append(painted(ball(hand, (0.05, 0.04, 0.05)), skin))
    return merge([*parts, *_upper_body(rng, tall, stout, jacket, skin)])


def _upper_body(
    rng: np.random.Generator, tall: float, stout: float, jacket: _Coat, skin: int
) -> list[Mesh]:
    """Trunk, head and hat or hair of a person."""
    levels = np.array([[0, 0, z] for z in (0.45, 0.5, 0.64, 0.78, 0.83, 0.86)]) * tall
    around = stout * np.array([0.12, 0.16, 0.155, 0.19, 0.18, 0.07])
    head = np.array([0.02, 0, 0.92 * tall])
    hat = ball(np.add(head, [0, 0, 0.06]), (0.12, 0.1, 0.08))
    return [
        jacket(limb(levels, around, 12, flat=0.65)),
        painted(ball(head, (0.10, 0.08, 0.12)), skin),
        painted(hat, int(rng.integers(_PAINTS))),
    ]


def beast(rng: np.random.Generator) -> Mesh:
    """A four-legged animal of 0.35 to 1.6 m: thin or stout legs; fur from black to white."""
    back = np.exp(rng.uniform(np.log(0.35), np.log(1.6)))
    long, deep = back * rng.uniform(0.95, 1.35), back * rng.uniform(0.17, 0.28)
    thick, belly = back * rng.uniform(0.018, 0.07), back - deep
    parts = [ball([0, 0, belly], (0.55 * long, 0.75 * deep, deep))]
    for x in (-0.36, 0.36):
        for side in (-1, 1):
            hoof = np.array([x * long + rng.uniform(-0.13, 0.13) * back, side * 0.4 * deep, 0.0])
            top = np.array([x * long, side * 0.42 * deep, belly])
            joint = 0.55 * hoof + 0.45 * top + [-0.06 * back * np.sign(x), 0, 0]
            radii = [1.2 * thick, thick, 1.3 * thick, max(2 * thick, 0.45 * deep)]
            parts.append(limb([hoof, 0.85 * hoof + 0.15 * joint, joint, top], radii, 8))
    tail = [-0.53 * long, 0, belly + 0.3 * deep]
    parts.append(limb([tail, np.add(tail, [-0.1, 0, -0.4 * back])], [0.03 * back, 0.02 * back], 6))
    whole = merge([*parts, *_front_and_rump(rng, back, long, deep)])
    if rng.random() < 0.3:
        return painted(whole, int(rng.choice([_WHITE, _DARK, *range(4, 12)])))
    return _clad(whole, Layer.FUR, float(rng.choice([0.1, 0.3, 0.7, 1.0, 1.7, 2.6])))


def _front_and_rump(rng: np.random.Generator, back: float, long: float, deep: float) -> list[Mesh]:
    """Neck, head, ears and rump of an animal with the height of its back, its length and depth."""
    belly, rise = back - deep, rng.uniform(-0.55, 0.6) * back
    head = np.array([0.66 * long, rng.uniform(-0.2, 0.2) * back, max(belly + rise, 0.12)])
    neck = np.array([[0.3 * long, 0, belly], [0.48 * long, 0, belly + 0.3 * rise], head])
    parts = [
        limb(neck, [0.9 * deep, 0.62 * deep, 0.34 * deep], 9),
        ball([-0.3 * long, 0, belly + 0.05 * deep], (0.3 * long, 0.7 * deep, 0.95 * deep)),
        ball(np.add(head, [0.08 * back, 0, 0]), (0.2 * back, 0.08 * back, 0.1 * back)),
    ]
    for side in (-1, 1):
        ear = np.add(head, [-0.04 * back, side * 0.06 * back, 0.0])
        tip = np.add(ear, [0, side * 0.03, 0.16 * back])
        parts.append(limb([ear, tip], [0.03 * back, 0.005], 5))
    return parts


def stake(rng: np.random.Generator) -> Mesh:
    """A round or square post of 4 to 32 cm, alone or with rails, from 0.5 to 3 m, often mossy."""
    radius = np.exp(rng.uniform(np.log(0.02), np.log(0.16)))
    high, lean = rng.uniform(0.5, 3.0), rng.normal(0, 0.05, 2)
    top = np.array([*(lean * high), high])
    if rng.random() < 0.3:
        post = block([0, 0, high / 2 - 0.15], (2 * radius, 2 * radius, high + 0.3), repeat_m=0.8)
    else:
        path = np.array([[0, 0, -0.3], 0.5 * top, top])
        post = limb(path, radius * rng.uniform(0.85, 1.1, 3), 12)
    if rng.random() < 0.3:
        post = painted(post, int(rng.integers(_PAINTS)))
    else:
        layer = _POST_LAYERS[rng.integers(len(_POST_LAYERS))]
        post = _clad(post, layer, float(rng.uniform(0.5, 1.2)))
    parts = [post]
    if rng.random() < 0.25:
        sleeve = np.array([[0, 0, -0.2], rng.uniform(0.1, 0.6) * top])
        moss = limb(sleeve, [1.15 * radius, 1.06 * radius], 12)
        parts.append(painted(moss, _MOSS))
    if rng.random() < 0.3:
        for level in high * np.linspace(0.35, 0.9, int(rng.integers(1, 4))):
            rail = [[0, -rng.uniform(0.5, 2), level], [0, rng.uniform(0.5, 2), level]]
            parts.append(limb(rail, [0.4 * radius + 0.01] * 2, 6))
    return merge(parts)


def dead_trunk(rng: np.random.Generator) -> Mesh:
    """A dead trunk of LOG_M: lying with bark or bare, or leaning and bare; or a dead limb."""
    form = rng.random()
    if form < 0.5:
        return lying_log(rng, LOG_M, float(np.exp(rng.uniform(np.log(0.06), np.log(0.26)))))
    if form < 0.75:
        return _leaning(rng)
    return _dead_limb(rng)


def _leaning(rng: np.random.Generator) -> Mesh:
    """A bare trunk with one end on the ground and the other 0.5 to 3.5 m above it."""
    lift, radius = rng.uniform(0.5, 3.5), np.exp(rng.uniform(np.log(0.04), np.log(0.16)))
    share = np.linspace(0, 1, 6)
    reach = np.sqrt(LOG_M**2 - lift**2)
    path = np.stack([(share - 0.5) * reach, 0 * share, lift * share], -1)
    path[1:-1, 1:] += rng.normal(0, 0.04, (4, 2))
    trunk = limb(path, radius * (1.1 - 0.5 * share), 10)
    stubs = []
    for at in rng.integers(1, 5, int(rng.integers(0, 5))):
        way = unit(np.add(rng.normal(0, 1, 3), [0.6, 0, 0]))
        tip = path[at] + way * rng.uniform(0.2, 0.9)
        stubs.append(limb([path[at], tip], [0.35 * radius, 0.15 * radius], 5))
    return _clad(merge([trunk, *stubs]), Layer.DEAD_WOOD, float(rng.uniform(0.6, 1.3)))


def _dead_limb(rng: np.random.Generator) -> Mesh:
    """A bleached, branched limb of about LOG_M / 2 that lies on its branches."""
    points, twigs = 7, int(rng.integers(5, 10))
    share = np.linspace(0, 1, points)
    main = np.stack([(share - 0.5) * LOG_M / 2, 0 * share, rng.uniform(0.1, 0.5) + 0 * share], -1)
    main[:, 1:] += np.cumsum(rng.normal(0, 0.08, (points, 2)), 0)
    main[:, 2] = np.maximum(main[:, 2], 0.05)
    thick = rng.uniform(0.025, 0.06) * (1 - 0.7 * share)
    at = rng.integers(1, points - 1, twigs)
    way = unit(np.add(rng.normal(0, 1, (twigs, 3)), [0.9, 0, 0.3]))
    reach = np.linspace(0, 1, 4)[:, None] * rng.uniform(0.4, 1.5, (twigs, 1, 1))
    side = main[at][:, None] + way[:, None] * reach
    side[:, 1:] += np.cumsum(rng.normal(0, 0.05, (twigs, 3, 3)), 1)
    fine = 0.6 * thick[at][:, None] * (1 - 0.25 * np.arange(4))
    tint = rng.uniform(0.9, 1.6)
    wood = merge(
        [
            tubes_mesh(main[None], thick[None], 7, Layer.DEAD_WOOD, tint, 0.4),
            tubes_mesh(side, fine, 5, Layer.DEAD_WOOD, tint, 0.4),
        ]
    )
    lowest = np.array([0, 0, wood.vertices[:, 2].min() + _SUNK_M], np.float32)
    return replace(wood, vertices=wood.vertices - lowest)


def high_stump(rng: np.random.Generator) -> Mesh:
    """A cut or rotten stump, stretched to at most _STUMP_M."""
    mesh = debris.stump(rng)
    grown = rng.uniform(0.8, 1.5)
    size = np.array(
        [grown, grown, min(grown * rng.uniform(1, 2), _STUMP_M / mesh.vertices[:, 2].max())]
    )
    normals = unit(np.asarray(mesh.normals) / size)
    return replace(mesh, vertices=(mesh.vertices * size).astype(np.float32), normals=normals)


def lens_twig(rng: np.random.Generator) -> Mesh:
    """A drooping twig with leaves, needles or neither, along x from the origin to TWIG_M."""
    share = np.linspace(0, 1, 5)
    path = np.stack([share, 0 * share, -rng.uniform(0, 0.3) * share**2], -1) * TWIG_M
    path[1:] += np.cumsum(rng.normal(0, 0.02, (4, 3)), 0)
    wood = tubes_mesh(path[None], 0.008 * (1.1 - share)[None], 5, Layer.DEAD_WOOD, 0.8, 0.4)
    count = int(rng.integers(4, 12))
    origins = path[rng.integers(0, 5, count)] + rng.normal(0, 0.03, (count, 3))
    axes = unit(np.add(rng.normal(0, 0.6, (count, 3)), [0.8, 0, -0.2]))
    sides = unit(np.cross(axes, rng.normal(0, 1, (count, 3))))
    size = rng.uniform(0.15, 0.4, count)
    layer = _LEAVES[rng.integers(len(_LEAVES))]
    tint = rng.uniform(0.7, 1.2, count)
    cards = Cards(origins, axes, sides, size, 0.8 * size)
    return merge([wood, cards_mesh(cards, origins - UP, layer, tint, 0.15)])


NEGATIVES: dict[str, Kind] = {
    "near_person": Kind(walker, 12),
    "near_animal": Kind(beast, 14),
    "near_post": Kind(stake, 18),
    "near_log": Kind(dead_trunk, 16),
    "near_stump": Kind(high_stump, 8),
    "lens_twig": Kind(lens_twig, 10),
}
