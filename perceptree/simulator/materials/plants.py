"""Textures of small plants, cut out by their alpha.

A plant extends from the middle of the left border to the right.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np

from basetree.arrays import Float, Float32
from perceptree.simulator.materials.drawing import cutout, ink, point
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.vectors import heading

Rgb = tuple[int, int, int]

_GREEN: tuple[Rgb, ...] = ((74, 86, 46), (94, 102, 56), (62, 74, 42), (120, 114, 70))
_STRAW: tuple[Rgb, ...] = ((158, 136, 88), (134, 110, 68), (176, 156, 108), (112, 92, 58))
_FERN: tuple[Rgb, ...] = ((62, 80, 42), (76, 94, 48), (92, 102, 56))
_SCRUB: tuple[Rgb, ...] = ((60, 78, 42), (76, 92, 50), (92, 104, 58), (102, 96, 58))
_HERB: tuple[Rgb, ...] = ((70, 104, 44), (88, 120, 52), (104, 132, 66), (60, 88, 46))
_BERRY: tuple[Rgb, ...] = ((74, 104, 56), (92, 116, 60), (62, 84, 50), (128, 96, 62))
_STALK: Rgb = (92, 78, 50)
_WOOD: Rgb = (84, 64, 48)


def plant_layers(rng: np.random.Generator) -> dict[Layer, Float]:
    """Draw grasses, ferns and bushes: colour and alpha (H, W, 4) by layer."""
    green = partial(_draw_blades, colours=_GREEN, count=60, bend=0.16)
    straw = partial(_draw_blades, colours=_STRAW, count=52, bend=0.26)
    return {
        Layer.GRASS: cutout(rng, green, _GREEN[0]),
        Layer.DRY_GRASS: cutout(rng, straw, _STRAW[0]),
        Layer.FERN: cutout(rng, _draw_frond, _FERN[0]),
        Layer.SCRUB: cutout(rng, _draw_bush, _SCRUB[0]),
    }


def low_plant_layers(rng: np.random.Generator) -> dict[Layer, Float]:
    """Draw herbs and dwarf shrubs: colour and alpha (H, W, 4) by layer."""
    return {
        Layer.HERB: cutout(rng, _draw_herb, _HERB[0]),
        Layer.BILBERRY: cutout(rng, _draw_bilberry, _BERRY[0]),
    }


def _tone(rng: np.random.Generator, colours: tuple[Rgb, ...], strength: float) -> tuple[float, ...]:
    return ink(colours[rng.integers(len(colours))], strength * rng.uniform(0.85, 1.15))


def _draw_blades(
    rng: np.random.Generator, canvas: Float32, colours: tuple[Rgb, ...], count: int, bend: float
) -> None:
    """Draw long bent blades, the short and dark ones behind."""
    size = canvas.shape[0]
    share = np.linspace(0, 1, 9)
    for number in range(count):
        length = size * rng.uniform(0.3, 0.62 + 0.34 * number / count)
        foot = size * np.clip(rng.normal(0.5, 0.15), 0.14, 0.86)
        lean, curl = rng.normal(0, 0.16) + 0.9 * (foot / size - 0.5), rng.normal(0, bend)
        swing = length * (lean * share + curl * share**2)
        room = (0.97 * size - foot if swing[-1] > 0 else foot - 0.03 * size) / np.abs(swing).max()
        across = foot + swing * min(1.0, room)
        half = rng.uniform(6, 11) * (1 - share**1.6) + 1.0
        upper = np.stack([length * share, across - half], -1)
        lower = np.stack([length * share, across + half], -1)
        strength = 0.62 + 0.5 * number / count
        outline = np.concatenate([upper, lower[::-1]]).astype(np.int32)
        cv2.fillPoly(canvas, [outline], _tone(rng, colours, strength))
        rib = np.stack([length * share, across], -1)[:-2].astype(np.int32)
        cv2.polylines(canvas, [rib], False, _tone(rng, colours, 0.8 * strength), 3)


def _draw_frond(rng: np.random.Generator, canvas: Float32) -> None:
    """Draw a bipinnate frond: pairs of pinnate leaflets on a bare stalk."""
    size, pairs = canvas.shape[0], 24
    cv2.line(canvas, point(0, size / 2), point(0.95 * size, size / 2), ink(_STALK, 1.0), 9)
    for share in np.linspace(0.12, 0.93, pairs):
        reach = 0.45 * size * min(1.0, 4.5 * (share - 0.02)) * (1.0 - share) ** 0.72
        for side in (-1, 1):
            foot = np.array([size * (share + rng.normal(0, 0.004)), size / 2])
            angle = side * (1.25 - 0.35 * share + rng.normal(0, 0.05))
            _draw_pinna(rng, canvas, foot, angle, reach * rng.uniform(0.88, 1.04))


def _draw_pinna(
    rng: np.random.Generator, canvas: Float32, foot: Float, angle_rad: float, length: float
) -> None:
    """Draw one leaflet with a notched edge: small ovals along both sides of its rib."""
    along = heading(angle_rad)
    strength = rng.uniform(0.75, 1.15)
    lobes = max(3, round(length / 17))
    for number in range(lobes):
        share = (number + 0.5) / lobes
        width = max(4.0, 24 * (1 - share) ** 0.7 * min(1.0, length / 160))
        for side in (-1, 1):
            turn = angle_rad + side * 0.95
            centre = foot + along * length * share
            centre = centre + 0.6 * width * heading(turn)
            axes = (max(2, round(0.75 * width)), max(2, round(0.42 * width)))
            tone = _tone(rng, _FERN, strength * (1.0 if side > 0 else 0.86))
            cv2.ellipse(canvas, point(*centre), axes, np.degrees(turn), 0, 360, tone, -1)
    tip = foot + along * length
    cv2.line(canvas, point(*foot), point(*tip), _tone(rng, _FERN, 0.8 * strength), 4)


def _draw_bush(rng: np.random.Generator, canvas: Float32) -> None:
    """Draw branching stems with many small oval leaves."""
    size = canvas.shape[0]
    foot = np.array([0.0, size / 2])
    shoots: list[tuple[Float, Float]] = []
    for angle in np.linspace(-0.55, 0.55, 7) + rng.normal(0, 0.06, 7):
        length = size * rng.uniform(0.55, 0.94) * np.cos(angle) ** 2
        tip = foot + length * np.array([np.cos(angle), 0.85 * np.sin(angle)])
        shoots.append((foot, tip))
        for share in rng.uniform(0.2, 0.9, 7):
            start = foot + (tip - foot) * share
            turn = angle + rng.choice([-1, 1]) * rng.uniform(0.35, 0.9)
            reach = length * rng.uniform(0.12, 0.3)
            shoots.append((start, start + reach * heading(turn)))
    for start, tip in shoots:
        cv2.line(canvas, point(*start), point(*tip), ink(_WOOD, rng.uniform(0.7, 1.1)), 6)
    for start, tip in shoots:
        span = float(np.hypot(*(tip - start)))
        along = np.arctan2(*(tip - start)[::-1])
        first = 0.3 if span > 0.5 * size else 0.1
        for share in np.arange(first, 1.02, 12 / span):
            _draw_oval(rng, canvas, start + (tip - start) * share, along)


def _draw_oval(rng: np.random.Generator, canvas: Float32, foot: Float, along_rad: float) -> None:
    """Draw one small leaf beside a shoot, inside the picture."""
    size = canvas.shape[0]
    turn = along_rad + rng.choice([-1, 1]) * rng.uniform(0.3, 1.2)
    half = rng.uniform(16, 27)
    centre = foot + 1.1 * half * heading(turn)
    centre = np.clip(centre, 30, size - 30)
    axes = (round(half), round(half * rng.uniform(0.38, 0.6)))
    tone = _tone(rng, _SCRUB, rng.uniform(0.7, 1.15))
    cv2.ellipse(canvas, point(*centre), axes, np.degrees(turn), 0, 360, tone, -1)


def _draw_herb(rng: np.random.Generator, canvas: Float32) -> None:
    """Draw broad leaves with midribs on stalks, the nearest ones last."""
    size = canvas.shape[0]
    for number in range(9):
        reach, across = rng.uniform(0.25, 0.82), rng.uniform(0.12, 0.88)
        tip = np.array([reach * size, across * size])
        cv2.line(canvas, point(0, size / 2), point(*tip), ink(_STALK, 0.9), 7)
        length, turn = size * rng.uniform(0.12, 0.2), rng.normal(2 * (across - 0.5), 0.5)
        axes = (round(length), round(length * rng.uniform(0.4, 0.65)))
        strength = 0.7 + 0.4 * number / 9
        tone = _tone(rng, _HERB, strength)
        cv2.ellipse(canvas, point(*tip), axes, np.degrees(turn), 0, 360, tone, -1)
        rib = 0.9 * length * heading(turn)
        rib_tone = _tone(rng, _HERB, 0.75 * strength)
        cv2.line(canvas, point(*(tip - rib)), point(*(tip + rib)), rib_tone, 4)


def _draw_bilberry(rng: np.random.Generator, canvas: Float32) -> None:
    """Draw upright twigs with many small leaves."""
    size = canvas.shape[0]
    for _ in range(9):
        end = np.array([size * rng.uniform(0.55, 0.95), size * rng.uniform(0.06, 0.94)])
        foot = np.array([0.0, size * rng.uniform(0.35, 0.65)])
        cv2.line(canvas, point(*foot), point(*end), ink(_STALK, 0.8), 5)
        for share in np.linspace(0.2, 1.0, 13):
            centre = foot + (end - foot) * share + rng.normal(0, 0.022 * size, 2)
            axes = (
                round(size * rng.uniform(0.016, 0.028)),
                round(size * rng.uniform(0.009, 0.016)),
            )
            tone = _tone(rng, _BERRY, rng.uniform(0.75, 1.15))
            cv2.ellipse(canvas, point(*centre), axes, rng.uniform(0, 180), 0, 360, tone, -1)
