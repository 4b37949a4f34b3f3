"""Ground textures: litter, moss, roots and mud; with rock and wood from `wood_and_rock`.

One repeat shows 1.7 m of ground, 3.3 mm per pixel.
"""

from __future__ import annotations

import cv2
import numpy as np

from basetree.arrays import Float, UInt8
from perceptree.simulator.materials.drawing import mix, noise, rgb
from perceptree.simulator.materials.layers import SIZE_PX, Layer
from perceptree.simulator.materials.noise import jittered_cells, smoothstep
from perceptree.simulator.materials.wood_and_rock import wood_and_rock_layers
from perceptree.simulator.vectors import heading

Rgb = tuple[int, int, int]

_NEEDLES: tuple[Rgb, ...] = (
    (122, 96, 68),
    (98, 72, 52),
    (142, 118, 88),
    (82, 64, 50),
    (112, 98, 72),
)
_LEAVES: tuple[Rgb, ...] = (
    (128, 96, 64),
    (104, 76, 54),
    (146, 120, 88),
    (84, 66, 52),
    (116, 92, 72),
    (98, 90, 62),
)
_TWIGS: tuple[Rgb, ...] = ((92, 78, 62), (106, 94, 78), (72, 58, 46))
_ROOTS: tuple[Rgb, ...] = ((96, 72, 52), (116, 92, 70), (84, 64, 50), (106, 86, 72))
_PEBBLES: tuple[Rgb, ...] = ((120, 114, 106), (98, 90, 82), (138, 130, 118))
_SHIFT = 3


def ground_layers(rng: np.random.Generator) -> dict[Layer, tuple[Float, Float]]:
    """Draw ground, rock and wood: colour (H, W, 3) and relief (H, W) by layer.

    All but the cut wood are seamless.
    """
    return {
        **wood_and_rock_layers(rng),
        Layer.LITTER: _litter(rng),
        Layer.MOSS: _moss(rng),
        Layer.ROOTS: _roots(rng),
        Layer.MUD: _mud(rng),
    }


def _canvas(colour: Float) -> UInt8:
    """A canvas (SIZE, SIZE, 4) uint8 to draw on: the colour, and relief 0."""
    base = np.zeros((SIZE_PX, SIZE_PX, 4), np.uint8)
    base[..., :3] = np.clip(colour, 0, 1) * 255
    return base


def _tone(rng: np.random.Generator, colours: tuple[Rgb, ...], low: float, high: float) -> Float:
    return np.array(colours[rng.integers(len(colours))]) * rng.uniform(low, high)


def _wraps(points_px: Float, reach_px: float) -> list[Float]:
    """The points (n, 2), and copies of them beyond the borders that they are close to."""
    low, high = points_px.min(0) - reach_px, points_px.max(0) + reach_px
    columns = [0] + [SIZE_PX] * bool(low[0] < 0) + [-SIZE_PX] * bool(high[0] >= SIZE_PX)
    rows = [0] + [SIZE_PX] * bool(low[1] < 0) + [-SIZE_PX] * bool(high[1] >= SIZE_PX)
    return [points_px + np.array([column, row]) for column in columns for row in rows]


def _line(canvas: UInt8, points_px: Float, tone: Float, level: float, width_px: int) -> None:
    for wrapped in _wraps(points_px, width_px + 1):
        fixed = np.round(wrapped * 2**_SHIFT).astype(np.int32)
        cv2.polylines(canvas, [fixed], False, (*tone, level), width_px, cv2.LINE_AA, _SHIFT)


def _polygon(canvas: UInt8, points_px: Float, tone: Float, level: float) -> None:
    for wrapped in _wraps(points_px, 2):
        fixed = np.round(wrapped * 2**_SHIFT).astype(np.int32)
        cv2.fillPoly(canvas, [fixed], (*tone, level), cv2.LINE_AA, _SHIFT)


def _strew_needles(rng: np.random.Generator, canvas: UInt8, count: int) -> None:
    """Scatter short thin needles, each above the previous ones."""
    feet, turns = rng.uniform(0, SIZE_PX, (count, 2)), rng.uniform(0, 2 * np.pi, count)
    for number, (foot, turn) in enumerate(zip(feet, turns, strict=True)):
        share = number / count
        ends = np.stack([foot, foot + rng.uniform(5, 10) * heading(turn)])
        _line(
            canvas,
            ends,
            _tone(rng, _NEEDLES, 0.4 + 0.35 * share, 0.7 + 0.45 * share),
            40 + 120 * share,
            1,
        )


def _strew_leaves(rng: np.random.Generator, canvas: UInt8, count: int, high: int) -> None:
    """Scatter fallen leaves, folded along their midrib so that one half is brighter."""
    outline = np.array([[0, 0], [0.25, 0.24], [0.55, 0.27], [0.85, 0.11], [1, 0]])
    for number in range(count):
        foot, turn = rng.uniform(0, SIZE_PX, 2), rng.uniform(0, 2 * np.pi)
        length = rng.uniform(10, 21)
        along, across = length * heading(turn), length * heading(turn + np.pi / 2)
        tone = _tone(rng, _LEAVES, 0.45, 0.92)
        level = high * (0.6 + 0.4 * number / count)
        curl = rng.uniform(0.6, 1.0)
        for side, shade in ((-1, 0.82), (1, 1.08)):
            half = foot + outline[:, :1] * along + side * curl * outline[:, 1:] * across
            _polygon(canvas, half, tone * shade, level * (0.9 if side < 0 else 1.0))
        _line(canvas, np.stack([foot - 0.15 * along, foot + along]), 0.75 * tone, level, 1)


def _strew_twigs(rng: np.random.Generator, canvas: UInt8, count: int) -> None:
    """Scatter crooked thin twigs with a bright upper side."""
    for _ in range(count):
        steps = rng.uniform(6, 20) * heading(rng.uniform(0, 2 * np.pi))
        bends = np.cumsum(steps + rng.normal(0, 2.0, (4, 2)), 0)
        points = rng.uniform(0, SIZE_PX, 2) + bends
        tone, width = _tone(rng, _TWIGS, 0.7, 1.15), int(rng.integers(2, 4))
        _line(canvas, points, 0.45 * tone, 150, width + 1)
        _line(canvas, points - 0.4, tone, 225, width - 1)


def _split(canvas: UInt8, depth: float) -> tuple[Float, Float]:
    """Colour and relief of a canvas."""
    drawn = canvas.astype(np.float32) / 255
    return drawn[..., :3], _soft(drawn[..., 3], 1) * depth


def _soft(field: Float, reach_px: int) -> Float:
    """Blur over 2 * reach + 1 px, wrapping at the borders."""
    padded = np.pad(field, 2 * reach_px, "wrap")
    size = (2 * reach_px + 1, 2 * reach_px + 1)
    edge = slice(2 * reach_px, -2 * reach_px)
    return np.asarray(cv2.blur(padded, size)[edge, edge])


def _litter(rng: np.random.Generator) -> tuple[Float, Float]:
    """Needles, fallen leaves and twigs on dark humus."""
    fine, broad = noise(rng, 0.9), noise(rng, 2.0)
    canvas = _canvas(mix(rgb(38, 30, 24), rgb(76, 60, 46), smoothstep(-1.3, 1.3, fine)))
    _strew_needles(rng, canvas, 3000)
    _strew_leaves(rng, canvas, 420, 200)
    _strew_needles(rng, canvas, 900)
    _strew_twigs(rng, canvas, 60)
    colour, relief = _split(canvas, 3.4)
    return colour * (1 + 0.08 * broad[..., None]), relief + 0.5 * broad


def _moss(rng: np.random.Generator) -> tuple[Float, Float]:
    """Moss cushions with fine stems, yellow-green or dark green, brown in places."""
    smooth, fine, broad = noise(rng, 3.4), noise(rng, 0.6), noise(rng, 2.4)
    dome, own = _cushions(rng, 13, smooth)
    lumps = 1 - np.minimum(1, np.abs(noise(rng, 1.9)))
    dome = dome * (0.75 + 0.25 * lumps)
    light = np.clip(0.24 + 0.52 * dome + 0.10 * fine + 0.06 * broad, 0, 1)
    deep = mix(rgb(28, 36, 16), rgb(92, 106, 46), light)
    yellow = mix(rgb(42, 44, 18), rgb(126, 124, 58), light)
    colour = mix(deep, yellow, np.clip(0.3 + 0.3 * broad + 0.4 * (own - 0.5), 0, 1))
    brown = mix(rgb(32, 25, 18), rgb(102, 80, 54), light)
    dried = smoothstep(0.7, 1.5, noise(rng, 2.2) + 0.6 * (own - 0.5) - 0.5 * dome)
    canvas = _canvas(mix(colour, brown, 0.85 * dried))
    _strew_needles(rng, canvas, 150)
    _strew_leaves(rng, canvas, 14, 60)
    return _split(canvas, 1.0)[0], 6.0 * dome + 0.35 * fine + broad


def _cushions(rng: np.random.Generator, across: int, warp: Float) -> tuple[Float, Float]:
    """Height of round cushions, 0 to 1, and a random number of each cushion, 0 to 1."""
    bent = np.roll(warp, (170, 90), (0, 1))
    edge, cell = jittered_cells(rng, (across, across), 1.5 * warp, 1.5 * bent)
    dome = np.sqrt(np.clip(edge / 0.65, 0, 1))
    own = rng.random(across * across).astype(np.float32)[cell]
    return _soft(dome * (0.7 + 0.3 * own), 2), own


def _roots(rng: np.random.Generator) -> tuple[Float, Float]:
    """A network of thin winding roots on dark humus with crumbs and a few needles."""
    fine, broad = noise(rng, 0.8), noise(rng, 2.0)
    shade = 0.6 * fine + 0.5 * broad
    canvas = _canvas(mix(rgb(33, 27, 22), rgb(68, 55, 44), smoothstep(-1.6, 1.6, shade)))
    _strew_needles(rng, canvas, 650)
    _strew_leaves(rng, canvas, 30, 70)
    for number in range(95):
        share = number / 95
        _root(rng, canvas, round(1.2 + 9.5 * share**3), 110 + 145 * share)
    colour, relief = _split(canvas, 5.5)
    return colour * (1 + 0.10 * fine[..., None]), relief + 0.35 * fine + 0.8 * broad


def _root(rng: np.random.Generator, canvas: UInt8, width_px: int, level: float) -> None:
    """Draw one winding, tapering root in bands of increasing relief."""
    steps = int(rng.integers(14, 30))
    turn = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.22, steps))
    steps_px = 9.0 * heading(turn)
    path = rng.uniform(0, SIZE_PX, 2) + np.cumsum(steps_px, 0)
    tone = _tone(rng, _ROOTS, 0.55, 0.92)
    for band, shade in ((1.35, 0.35), (1.0, 0.7), (0.7, 0.9), (0.35, 1.12)):
        for first in range(0, steps - 1, 3):
            taper = min(1.0, 0.3 + 0.25 * first, 1.1 - first / steps)
            width = max(1, round(width_px * taper * band))
            _line(canvas, path[first : first + 4], shade * tone, level * (1.2 - 0.6 * band), width)


def _mud(rng: np.random.Generator) -> tuple[Float, Float]:
    """Dark wet, compressed soil with footprints, shallow pools, and a few pebbles and leaves."""
    fine, medium, broad = noise(rng, 1.2), noise(rng, 3.3), noise(rng, 3.6)
    height = 1.3 * medium + 1.1 * broad - _prints(rng)
    pool = 1 - smoothstep(-3.0, -2.2, height)
    shade = smoothstep(-3.0, 3.0, height + 0.35 * fine)
    colour = mix(rgb(42, 34, 27), rgb(70, 57, 45), shade)
    colour = mix(colour, rgb(44, 38, 32), 0.8 * pool)
    canvas = _canvas(colour)
    _strew_leaves(rng, canvas, 16, 40)
    _strew_needles(rng, canvas, 120)
    for _ in range(30):
        radii = rng.uniform(1.5, 4.5) * rng.uniform(0.7, 1.0, (9, 1))
        around = heading(np.arange(9) * 0.7)
        _polygon(
            canvas,
            rng.uniform(0, SIZE_PX, 2) + radii * around,
            _tone(rng, _PEBBLES, 0.5, 0.85),
            150,
        )
    drawn, pressed = _split(canvas, 2.5)
    wet = np.maximum(height, -2.6) + 0.05 * fine * (1 - pool)
    return drawn, 0.9 * wet + 0.6 * pressed


def _prints(rng: np.random.Generator) -> Float:
    """Depth of footprints with the pattern of the soles; negative on the rims around them."""
    sunk = np.zeros((SIZE_PX, SIZE_PX, 4), np.uint8)
    angle = np.linspace(0, 2 * np.pi, 18)[:-1, None]
    for _ in range(9):
        centre, turn = rng.uniform(0, SIZE_PX, 2), rng.uniform(0, 2 * np.pi)
        along, across = heading(turn), heading(turn + np.pi / 2)
        deep = rng.uniform(130, 255)
        for offset, half, wide in ((14, 25, 15), (-27, 13, 12)):
            rim = centre + (offset + half * np.cos(angle)) * along + wide * np.sin(angle) * across
            _polygon(sunk, rim, np.zeros(3), deep)
        for offset in range(-34, 36, 9):
            ends = centre + offset * along + np.array([[-10], [10]]) * across
            _line(sunk, ends, np.zeros(3), 0.72 * deep, 2)
    depth = sunk[..., 3].astype(np.float32) / 255
    return _soft(depth, 1) * 4.5 - _soft(depth, 9) * 2.0
