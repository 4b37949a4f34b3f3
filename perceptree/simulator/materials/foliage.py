"""Twig textures of each species, cut out by their alpha.

A twig extends from the middle of the left border to the right, and is about 1 m long.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import cv2
import numpy as np

from basetree.arrays import Float, Float32
from perceptree.simulator.materials.drawing import cutout, ink, point
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.rows import read_rows
from perceptree.simulator.vectors import heading

Rgb = tuple[int, int, int]


@dataclass(frozen=True)
class Needles:
    """Parameters of a conifer's twig: side shoots with needles.

    Attributes:
        colours: Range of the needle colours, 8-bit sRGB.
        bark: Colour of the wood, 8-bit sRGB.
        shoots: Number of side shoots on each side.
        angle_rad: Range of the angle between shoot and twig.
        reach: Length of the longest shoot over that of the twig.
        ragged: Largest random reduction of a shoot's length, as a fraction.
        pointed: Exponent by which shoots get shorter towards the tip.
        needle_px: Length of the needles on the canvas, px.
        width_px: Width of the needles on the canvas, px.
        every_px: Distance between needles on the canvas, px.
        spread_rad: Range of the angle between needle and shoot.
        tuft: Last fraction of a shoot that has needles.
    """

    colours: tuple[Rgb, Rgb]
    bark: Rgb
    shoots: int
    angle_rad: tuple[float, float]
    reach: float
    ragged: float
    pointed: float
    needle_px: float
    width_px: int
    every_px: float
    spread_rad: tuple[float, float]
    tuft: float


@dataclass(frozen=True)
class Leaves:
    """Parameters of a broadleaved twig: side shoots with leaves.

    Attributes:
        colours: Range of the leaf colours, 8-bit sRGB.
        bark: Colour of the wood, 8-bit sRGB.
        outline: Outline of half a leaf: points along and across it, over its length.
        shoots: Number of side shoots on each side.
        count: Number of leaves.
        length_px: Range of the length of the leaves on the canvas, px.
        reach: Length of the longest shoot over that of the twig.
    """

    colours: tuple[Rgb, Rgb]
    bark: Rgb
    outline: tuple[tuple[float, float], ...]
    shoots: int
    count: int
    length_px: tuple[float, float]
    reach: float


_DRY: Rgb = (82, 75, 68)


def foliage_layers(rng: np.random.Generator) -> dict[Layer, Float]:
    """Draw the twigs of every species: colour and alpha (H, W, 4) by layer."""
    layers: dict[Layer, Float] = {}
    for name, row in read_rows("materials/needles.json").items():
        needles = Needles(**row)
        draw = partial(_draw_needles, kind=needles)
        layers[Layer[name]] = cutout(rng, draw, needles.colours[0])
    for name, row in read_rows("materials/leaves.json").items():
        leaves = Leaves(**row)
        draw = partial(_draw_leaves, kind=leaves)
        layers[Layer[name]] = cutout(rng, draw, leaves.colours[0])
    layers[Layer.BARE_TWIG] = cutout(rng, _draw_bare, _DRY)
    for layer in layers.values():
        layer[:2, :, 3] = layer[-2:, :, 3] = layer[:, -2:, 3] = 0.0
    return layers


def _tone(rng: np.random.Generator, colours: tuple[Rgb, Rgb]) -> tuple[float, float, float, float]:
    """A random colour between two, with random brightness."""
    share, strength = rng.random(), rng.uniform(0.72, 1.2)
    mixed = [low + (high - low) * share for low, high in zip(*colours, strict=True)]
    return ink((round(mixed[0]), round(mixed[1]), round(mixed[2])), strength)


def _shoots(
    rng: np.random.Generator,
    size: int,
    count: int,
    angle_rad: tuple[float, float],
    reach: float,
    pointed: float,
    ragged: float,
    margin_px: float,
) -> list[tuple[Float, Float]]:
    """Start and end (2,) px of side shoots on both sides, then of the twig itself."""
    shoots = []
    for share in 0.05 + 0.86 * (np.arange(count) + rng.uniform(0, 0.3, count)) / count:
        for side in (-1, 1):
            length = size * reach * (1 - share) ** pointed * rng.uniform(1 - ragged, 1.0)
            angle = side * rng.uniform(*angle_rad)
            start = np.array([size * (share + 0.02 * rng.random()), size / 2])
            towards = heading(angle)
            room = np.array([0.98 * size - start[0], 0.49 * size]) - margin_px
            length = min(length, *(room / np.maximum(1e-6, np.abs(towards))))
            shoots.append((start, start + max(length, 1.0) * towards))
    shoots.append((np.array([0.0, size / 2]), np.array([0.97 * size - margin_px, size / 2])))
    return shoots


def _draw_needles(rng: np.random.Generator, canvas: Float32, kind: Needles) -> None:
    size = canvas.shape[0]
    shoots = _shoots(
        rng,
        size,
        kind.shoots,
        kind.angle_rad,
        kind.reach,
        kind.pointed,
        kind.ragged,
        0.8 * kind.needle_px,
    )
    for number, (start, end) in enumerate(shoots):
        last = number == len(shoots) - 1
        cv2.line(canvas, point(*start), point(*end), ink(kind.bark, 0.9), 9 if last else 5)
    for start, end in shoots:
        length = float(np.hypot(*(end - start)))
        along = np.arctan2(*(end - start)[::-1])
        for way in np.arange(1 - kind.tuft, 1.0, kind.every_px / length):
            foot = start + (end - start) * way
            for side in (-1, 1):
                turn = along + side * rng.uniform(*kind.spread_rad)
                reach = kind.needle_px * rng.uniform(0.75, 1.1)
                tip = foot + reach * heading(turn)
                tone = _tone(rng, kind.colours)
                cv2.line(canvas, point(*foot), point(*tip), tone, kind.width_px)


def _draw_leaves(rng: np.random.Generator, canvas: Float32, kind: Leaves) -> None:
    size = canvas.shape[0]
    shoots = _shoots(
        rng, size, kind.shoots, (0.55, 0.95), kind.reach, 0.5, 0.6, 0.7 * kind.length_px[0]
    )
    for number, (start, end) in enumerate(shoots):
        width = 8 if number == len(shoots) - 1 else 4
        cv2.line(canvas, point(*start), point(*end), ink(kind.bark, 1), width)
    half = np.array(kind.outline)
    outline = np.concatenate([half, half[-2:0:-1] * [1, -1]])
    for start, end in shoots:
        along = np.arctan2(*(end - start)[::-1])
        count = round(kind.count * min(1.0, 0.35 + np.hypot(*(end - start)) / (0.4 * size)))
        for number in range(count):
            foot = start + (end - start) * (0.12 + 0.86 * (number + rng.random()) / count)
            turn = along + (-1) ** number * rng.uniform(0.4, 1.1)
            _draw_leaf(rng, canvas, kind, outline, foot, turn)


def _draw_leaf(
    rng: np.random.Generator,
    canvas: Float32,
    kind: Leaves,
    outline: Float,
    foot: Float,
    turn_rad: float,
) -> None:
    """Draw one leaf with its midrib; its width varies as if it were rotated about its axis."""
    length = rng.uniform(*kind.length_px)
    along = length * heading(turn_rad)
    across = np.array([-along[1], along[0]]) * rng.uniform(0.6, 1.0)
    base = foot + 0.12 * along
    shape = base + outline[:, :1] * along + outline[:, 1:] * across
    tone = _tone(rng, kind.colours)
    cv2.line(canvas, point(*foot), point(*base), ink(kind.bark, 1), 3)
    cv2.fillPoly(canvas, [shape.astype(np.int32)], tone)
    rib = (tone[0] * 1.25, tone[1] * 1.2, tone[2] * 1.25, 1.0)
    cv2.line(canvas, point(*base), point(*(base + 0.9 * along)), rib, 3)


def _draw_bare(rng: np.random.Generator, canvas: Float32) -> None:
    size = canvas.shape[0]
    for start, end in _shoots(rng, size, 9, (0.45, 1.0), 0.55, 0.5, 0.5, 40.0):
        _draw_bare_shoot(rng, canvas, start, end, 8.0)


def _draw_bare_shoot(
    rng: np.random.Generator, canvas: Float32, start: Float, end: Float, width: float
) -> None:
    """Draw a crooked shoot with finer side shoots."""
    steps = start + (end - start) * np.linspace(0, 1, 5)[:, None]
    length = float(np.hypot(*(end - start)))
    steps[1:] += rng.normal(0, 0.025 * length, (4, 2))
    for first, second in pairwise(steps):
        strength = rng.uniform(0.8, 1.15)
        cv2.line(canvas, point(*first), point(*second), ink(_DRY, strength), max(3, round(width)))
    if width < 5:
        return
    along = np.arctan2(*(end - start)[::-1])
    for number in range(round(length / 60)):
        foot = steps[1 + number % 4]
        turn = along + (-1) ** number * rng.uniform(0.4, 1.0)
        reach = length * rng.uniform(0.15, 0.38)
        tip = foot + reach * heading(turn)
        _draw_bare_shoot(rng, canvas, foot, tip, 0.55 * width)
