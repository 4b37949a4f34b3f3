"""Bark textures of every tree model, composed of plates, furrows and marks.

The parameters, in `barks.json`, were chosen by eye.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import cv2
import numpy as np

from basetree.arrays import Float
from perceptree.simulator.materials.drawing import mix, noise
from perceptree.simulator.materials.layers import SIZE_PX, Layer
from perceptree.simulator.materials.noise import jittered_cells, smoothstep
from perceptree.simulator.rows import read_rows

Rgb = tuple[int, int, int]

_LICHEN: Rgb = (168, 176, 156)
_MOSS: Rgb = (82, 86, 48)


@dataclass(frozen=True)
class Marks:
    """Ellipses scattered over the bark: resin blisters, scars, lenticels or dark patches.

    Attributes:
        count: Number of ellipses.
        half_px: Mean half axes around and along the stem, px.
        colour: 8-bit sRGB.
        strength: Opacity, 0 to 1.
        relief: Height, negative for depressions.
    """

    count: int
    half_px: tuple[float, float]
    colour: Rgb
    strength: float
    relief: float


@dataclass(frozen=True)
class Bark:
    """Parameters of one bark. Colours are 8-bit sRGB.

    Attributes:
        dark: Darkest tone.
        light: Lightest tone.
        crack: Colour of cracks and joints.
        plates: Number of plates around and along one repeat of the texture; None for no plates.
        joint: Width of the joints between plates, as a fraction of a plate.
        furrows: Width of vertical furrows, as a fraction of their distance.
        ridge_px: Approximate distance of furrows, px.
        patch: Colour of patches.
        patches: Fraction of the surface covered by patches.
        marks: Marks on the bark.
        grain: Strength of fine grain.
        flakes: Strength of thin layers with vertical edges on the plates.
        lichen: Fraction of the surface covered by lichen.
        moss: Fraction of the surface covered by moss.
    """

    dark: Rgb
    light: Rgb
    crack: Rgb
    plates: tuple[int, int] | None = None
    joint: float = 0.1
    furrows: float = 0.0
    ridge_px: float = 24.0
    patch: Rgb = (0, 0, 0)
    patches: float = 0.0
    marks: tuple[Marks, ...] = ()
    grain: float = 0.08
    flakes: float = 0.0
    lichen: float = 0.0
    moss: float = 0.0


_MARKS = {
    "blisters": Marks(420, (3.5, 2.4), (150, 144, 134), 0.55, 0.9),
    "knots": Marks(7, (9.0, 7.0), (48, 42, 38), 0.7, -0.5),
    "lenticels": Marks(230, (13.0, 1.5), (52, 46, 42), 0.85, 0.35),
    "spots": Marks(90, (6.0, 2.0), (70, 66, 58), 0.5, 0.2),
    "eyes": Marks(10, (17.0, 6.0), (54, 52, 47), 0.75, -0.7),
    "black": Marks(11, (34.0, 11.0), (38, 34, 31), 0.95, -0.5),
}
_BARKS = {
    Layer[name]: Bark(**row) for name, row in read_rows("materials/barks.json", _MARKS).items()
}


class _Fields:
    """Periodic noise fields that are drawn once and reused with random shifts and flips."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._drawn: dict[tuple[float, float], Float] = {}

    def __call__(self, exponent: float, upright: float = 1.0) -> Float:
        key = (exponent, upright)
        if key not in self._drawn:
            self._drawn[key] = noise(self._rng, exponent, upright, 1.0)
        rows, columns = self._rng.integers(0, SIZE_PX, 2)
        flipped = self._drawn[key][:: 1 - 2 * int(self._rng.integers(2))]
        return np.roll(flipped, (rows, columns), (0, 1))


def bark_layers(rng: np.random.Generator) -> dict[Layer, tuple[Float, Float]]:
    """Draw all barks: seamless colour (H, W, 3) and relief (H, W) by layer."""
    fields = _Fields(rng)
    return {layer: _paint(rng, fields, bark) for layer, bark in _BARKS.items()}


def _paint(rng: np.random.Generator, fields: _Fields, bark: Bark) -> tuple[Float, Float]:
    fine, broad = fields(0.9), fields(2.2)
    tone = np.asarray(0.5 + 0.16 * broad + 0.08 * fine)
    relief = 0.2 * broad + 1.2 * bark.grain * fine
    depth = np.zeros_like(tone)
    if bark.plates:
        joint, own = _plates(rng, fields, bark.plates, bark.joint)
        tone, depth = tone * 0.6 + 0.4 * own, joint
        relief = relief + 0.5 * own
    if bark.flakes:
        layers = fields(2.4, 1.8) * 1.6
        step = bark.flakes * (layers - np.floor(layers))
        tone, relief = tone - 0.3 * step + 0.15 * bark.flakes, relief - 0.6 * step
    if bark.furrows:
        depth = np.maximum(depth, _furrows(fields, bark))
    colour = mix(_rgb(bark.dark), _rgb(bark.light), np.clip(tone, 0, 1))
    colour = mix(colour, _rgb(bark.patch), 0.7 * _covered(fields(2.2, 1.6), bark.patches, 0.5))
    colour = mix(colour, _rgb(bark.crack), 0.85 * depth)
    relief = relief - 1.6 * depth
    for marks in bark.marks:
        colour, relief = _strew(rng, fields, colour, relief, marks)
    colour = colour * (1 + bark.grain * fields(0.7)[..., None])
    crust = _covered(fields(1.5) + 0.4 * fields(0.9), bark.lichen, 0.25)
    colour = mix(colour, _rgb(_LICHEN) * (1 + 0.1 * fine[..., None]), 0.85 * crust)
    growth = _covered(broad - 0.5 * depth + 0.35 * fields(1.2), bark.moss, 0.6)
    colour = mix(colour, _rgb(_MOSS) * (1 + 0.28 * fields(0.7)[..., None]), 0.9 * growth)
    return np.clip(colour, 0, 1), relief + 0.25 * crust + growth * (0.5 + 0.4 * fields(0.9))


def _rgb(colour: Rgb) -> Float:
    return np.array(colour, np.float32) / 255


def _covered(field: Float, share: float, softness: float) -> Float:
    """Soft mask of the given fraction of the surface, where a unit-deviation field is highest."""
    if not share:
        return np.zeros_like(field)
    level = NormalDist().inv_cdf(1 - share) * float(field.std())
    return smoothstep(level - softness / 2, level + softness / 2, field)


def _plates(
    rng: np.random.Generator, fields: _Fields, plates: tuple[int, int], joint: float
) -> tuple[Float, Float]:
    """Depth of the joints between plates, and a random tone of each plate, 0 to 1."""
    edge, cell = jittered_cells(rng, plates, fields(2.9), fields(2.9))
    tone = rng.random(plates[0] * plates[1]).astype(np.float32)[cell]
    width = joint * (1 + 0.4 * np.clip(fields(1.4), -1, 2))
    return 1 - smoothstep(0.0, 1.0, edge / width), tone


def _furrows(fields: _Fields, bark: Bark) -> Float:
    """Depth of the vertical furrows, which split and merge around long ridges."""
    columns = np.arange(SIZE_PX, dtype=np.float32) / SIZE_PX
    phase = np.pi * 2 * round(SIZE_PX / (2 * bark.ridge_px)) * columns
    left = np.abs(np.sin(phase + 2.3 * fields(3.7, 2.2)))
    right = np.abs(np.sin(phase + 2.3 * fields(3.7, 2.2) + 1.0))
    ridge = np.minimum(left, right + 0.12) + 0.08 * fields(1.6, 2.0)
    return 1 - smoothstep(0.2 * bark.furrows, 1.8 * bark.furrows, ridge)


def _strew(
    rng: np.random.Generator, fields: _Fields, colour: Float, relief: Float, marks: Marks
) -> tuple[Float, Float]:
    """Scatter ellipses of random sizes with irregular borders, wrapping at the texture's edges."""
    stamp = np.zeros((SIZE_PX, SIZE_PX), np.float32)
    centres = rng.integers(0, SIZE_PX, (marks.count, 2))
    sizes = np.array(marks.half_px) * rng.lognormal(0, 0.45, (marks.count, 2))
    strengths = rng.uniform(0.5, 1.0, marks.count)
    for (x, y), size, strength in zip(centres, sizes, strengths, strict=True):
        axes = (max(1, round(size[0])), max(1, round(size[1])))
        for column in (x, x - SIZE_PX, x + SIZE_PX):
            for row in (y, y - SIZE_PX, y + SIZE_PX):
                if -90 < column < SIZE_PX + 90 and -90 < row < SIZE_PX + 90:
                    cv2.ellipse(stamp, (int(column), int(row)), axes, 0, 0, 360, strength, -1)
    rim_px = max(2, round(0.8 * marks.half_px[1]))
    padded = np.pad(stamp, rim_px, "wrap")
    soft = cv2.blur(padded, (2 * rim_px + 1, rim_px + 1))[rim_px:-rim_px, rim_px:-rim_px]
    soft = smoothstep(0.25, 0.7, soft * (1 + 0.4 * fields(1.6, 0.6)))
    return mix(colour, _rgb(marks.colour), marks.strength * soft), relief + marks.relief * soft
