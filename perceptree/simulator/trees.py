"""Trees: a stem described by formulas, and crowns that bend with it.

A stem's axis and radius are functions of the height above its foot, so that labels and mesh come
from one description. Crowns are prototypes around a straight axis, shared between trees.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.mesh import UP, Mesh, cards_mesh, merge, surface_mesh, tubes_mesh, unit
from perceptree.simulator.textures import Layer

Float = NDArray[np.floating[Any]]

BREAST_HEIGHT_M = 1.3
STEM_SIDES = 48
CROWN_HEIGHT_M = 16.0
_FOOT_M = -0.45


@dataclass(frozen=True)
class Stem:
    """One stem, standing at the origin with z up.

    ``lean`` (2,) is the tangent of its lean along x and y, ``sweep_m`` and ``sweep_phase`` (2,)
    its bends; ``flare`` the extra radius of the root collar with ``lobes`` roots; ``bumps`` (k, 4)
    amplitude, turns, waves per metre and phase of its irregular section.
    """

    species: str
    diameter_m: float
    height_m: float
    lean: Float
    sweep_m: Float
    sweep_phase: Float
    flare: float
    lobes: int
    bumps: Float

    def axis(self, height_m: Float) -> Float:
        """(..., 3) points of the axis, metres, at heights above the foot."""
        wave = np.sin(height_m[..., None] / 3.3 + self.sweep_phase) - np.sin(self.sweep_phase)
        across = self.lean * height_m[..., None] + self.sweep_m * wave
        return np.concatenate([across, height_m[..., None]], -1)

    def direction(self, height_m: float) -> Float:
        """(3,) unit vector along the axis, upwards."""
        ends = self.axis(np.array([height_m - 0.01, height_m + 0.01]))
        return unit(ends[1] - ends[0])

    def radius_m(self, height_m: Float, angle_rad: Float) -> Float:
        """(heights, angles) radius of the bark."""
        taper = (1 - 0.86 * height_m / self.height_m) / (1 - 0.86 * BREAST_HEIGHT_M / self.height_m)
        collar = np.exp(-np.maximum(height_m, -0.1) / 0.24)[:, None]
        lobes = 0.5 + 0.5 * np.cos(self.lobes * angle_rad)[None]
        shape = 1 + self.flare * collar * (0.3 + lobes**2)
        for amplitude, turns, waves, phase in self.bumps:
            turn = np.round(turns) * angle_rad[None] + waves * height_m[:, None] + phase
            shape = shape + amplitude * np.sin(turn)
        return np.asarray(0.5 * self.diameter_m * taper[:, None] * shape)

    def rings(self, height_m: Float, sides: int) -> Float:
        """(heights, sides + 1, 3) points of the bark on sections across the axis."""
        angle = np.linspace(0.0, 2 * np.pi, sides + 1)
        centres = self.axis(height_m)
        tangent = unit(self.axis(height_m + 0.01) - self.axis(height_m - 0.01))
        first = unit(np.cross(np.array([0.0, 1.0, 0.0]), tangent))
        second = np.cross(tangent, first)
        across = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
        radius = self.radius_m(height_m, angle)
        return np.asarray(centres[:, None] + across * radius[..., None])

    def girth_diameter_m(self, height_m: float) -> float:
        """Convex girth of the section over pi: what a tape reads."""
        ring = self.rings(np.array([height_m]), 4 * STEM_SIDES)[0] - self.axis(np.array(height_m))
        axis = self.direction(height_m)
        first = unit(np.cross(np.array([0.0, 1.0, 0.0]), axis))
        flat = np.stack([ring @ first, ring @ np.cross(axis, first)], -1).astype(np.float32)
        return float(cv2.arcLength(cv2.convexHull(flat), True)) / np.pi


def random_stem(
    rng: np.random.Generator, species: str, diameter_m: float, lean_std_deg: float, max_deg: float
) -> Stem:
    """Draw a stem of a given breast-height diameter."""
    height_m = 1.3 + 23.0 * (1 - np.exp(-5.2 * diameter_m)) * rng.uniform(0.85, 1.15)
    lean_deg = min(abs(rng.normal(0, lean_std_deg)), max_deg)
    direction = rng.uniform(0, 2 * np.pi)
    lean = np.tan(np.radians(lean_deg)) * np.array([np.cos(direction), np.sin(direction)])
    count = 4
    bumps = np.stack(
        [
            rng.normal(0, 0.014 if species == "fir" else 0.010, count),
            rng.integers(2, 6, count).astype(float),
            rng.normal(0, 2.0, count),
            rng.uniform(0, 2 * np.pi, count),
        ],
        -1,
    )
    return Stem(
        species,
        diameter_m,
        float(height_m),
        lean,
        rng.normal(0, 0.08, 2) * min(1.0, height_m / 15),
        rng.uniform(0, 2 * np.pi, 2),
        float(rng.uniform(0.15, 0.42)),
        int(rng.integers(4, 8)),
        bumps,
    )


def stem_mesh(stem: Stem, label_heights_m: tuple[float, ...], near: bool) -> Mesh:
    """The stem's bark, with a ring at every height of ``label_heights_m`` (last: labels' top)."""
    rings, sides = (40, STEM_SIDES) if near else (6, 7)
    reach = _FOOT_M + (stem.height_m - _FOOT_M) * np.linspace(0, 1, rings) ** 1.7
    heights = np.unique(np.concatenate([reach, label_heights_m if near else ()]))
    layer = Layer.FIR_BARK if stem.species == "fir" else Layer.BEECH_BARK
    repeats = max(1, round(np.pi * stem.diameter_m / 0.75))
    vertices = stem.rings(heights, sides)[None]
    mesh = surface_mesh(vertices, stem.axis(heights)[None], layer, repeats, 0.75, 1.0)
    if near:
        top = np.searchsorted(heights, label_heights_m[-1])
        mesh.labelled[: top * sides * 2] = True
    return mesh


def _branches(
    rng: np.random.Generator, height_m: Float, length_m: Float, rise: float, droop: float,
    thickness_m: float, knots: int,
) -> tuple[Mesh, Float, Float]:  # fmt: skip
    """Thin curved tubes from the axis outwards: mesh, curves (n, knots, 3), azimuths (n,)."""
    count = len(height_m)
    azimuth = np.arange(count) * 2.4 + rng.normal(0, 0.4, count)
    share = np.linspace(0, 1, knots)
    out = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)], -1)
    slope = (rise + rng.normal(0, 0.12, count))[:, None] * share - droop * share**2
    curves = UP * height_m[:, None, None] + out[:, None] * (length_m[:, None] * share)[..., None]
    curves = curves + UP * (length_m[:, None] * slope)[..., None]
    wobble = rng.normal(0, 0.05, (count, knots, 3)) * share[None, :, None]
    curves = curves + wobble * length_m[:, None, None]
    radius = (thickness_m * np.sqrt(length_m))[:, None] * (1 - 0.85 * share)
    return tubes_mesh(curves, radius, 3, Layer.DEAD_WOOD, 0.75, 0.5), curves, azimuth


def _along(curves: Float, share: Float) -> Float:
    """Points on curves (n, K, 3) at shares (n, m) of their length: (n, m, 3)."""
    position = share * (curves.shape[1] - 1)
    knot = np.minimum(position.astype(int), curves.shape[1] - 2)
    rest = (position - knot)[..., None]
    branch = np.arange(len(curves))[:, None]
    return np.asarray(curves[branch, knot] * (1 - rest) + curves[branch, knot + 1] * rest)


def _twigs(
    rng: np.random.Generator, points: Float, azimuth: Float, length_m: Float, tint: Float,
    layer: Layer, rise: tuple[float, float], roll: float, ratio: float,
) -> Mesh:  # fmt: skip
    axis = np.stack(
        [np.cos(azimuth), np.sin(azimuth), rng.normal(rise[0], rise[1], azimuth.shape)], -1
    )
    turn = rng.normal(0, roll, azimuth.shape)
    side = np.stack(
        [-np.sin(azimuth) * np.cos(turn), np.cos(azimuth) * np.cos(turn), np.sin(turn)], -1
    )
    points = points.reshape(-1, 3)
    stem = points * np.array([0.0, 0.0, 1.0]) - 0.4 * UP
    length = length_m.ravel()
    return cards_mesh(
        points, axis.reshape(-1, 3), side.reshape(-1, 3), length, length * ratio, stem, layer,
        tint.ravel(),
    )  # fmt: skip


def fir_crown(rng: np.random.Generator, near: bool) -> Mesh:
    """Crown of a fir 16 m high around a straight axis, with dead lower branches when near."""
    base, height = rng.uniform(3.6, 7.5), CROWN_HEIGHT_M
    count, cards, enlarge, knots = (72, 6, 1.0, 4) if near else (26, 2, 2.4, 3)
    at = np.sort(rng.uniform(base, height * 0.98, count))
    reach = 0.35 + 2.5 * (1 - (at - base) / (height - base)) ** 0.8
    length = reach * rng.uniform(0.7, 1.15, count)
    wood, curves, azimuth = _branches(rng, at, length, 0.12, 0.42, 0.014, knots)
    share = rng.uniform(0.22, 1.0, (count, cards))
    share[:, 0] = 0.93
    fan = np.where(np.arange(cards) % 2, 0.85, -0.85) + rng.normal(0, 0.2, (count, cards))
    fan[:, 0] = 0.0
    size = (length[:, None] * (0.62 - 0.3 * share) + 0.12) * enlarge
    tint = np.clip(0.45 + 0.75 * share, 0, 1.15) * rng.uniform(0.8, 1.15, share.shape)
    twigs = _twigs(
        rng, _along(curves, share), azimuth[:, None] + fan,
        size * rng.uniform(0.8, 1.2, share.shape), tint, Layer.FIR_TWIG, (-0.18, 0.12), 0.45, 0.72,
    )  # fmt: skip
    if not near:
        return merge([wood, twigs])
    dead_at = np.sort(rng.uniform(0.9, base + 1.5, 40))
    dead_length = 0.35 + 0.9 * rng.random(40)
    return merge([wood, twigs, _branches(rng, dead_at, dead_length, -0.05, 0.15, 0.0085, 4)[0]])


def beech_crown(rng: np.random.Generator, near: bool) -> Mesh:
    """Crown of a beech 16 m high around a straight axis."""
    base, height = rng.uniform(3.8, 6.5), CROWN_HEIGHT_M
    count, cards, enlarge, knots = (28, 18, 1.0, 5) if near else (14, 5, 1.8, 3)
    at = np.sort(rng.uniform(base, height * 0.95, count))
    share = np.clip((at - base) / (height - base) * 0.8 + 0.18, 0, 1)
    length = (0.8 + 3.0 * np.sin(np.pi * share)) * rng.uniform(0.7, 1.15, count)
    wood, curves, azimuth = _branches(rng, at, length, 0.45, 0.15, 0.022, knots)
    spot = rng.uniform(0.25, 1.0, (count, cards))
    points = _along(curves, spot) + rng.normal(0, 0.18, (count, cards, 3))
    size = rng.uniform(0.45, 0.95, spot.shape) * enlarge
    tint = 0.6 + 0.5 * spot * rng.uniform(0.7, 1.2, spot.shape)
    leaves = _twigs(
        rng, points, azimuth[:, None] + rng.normal(0, 1.0, spot.shape), size, tint, Layer.LEAVES,
        (0.0, 0.2), 0.5, 0.8,
    )  # fmt: skip
    return merge([wood, leaves])


def fit_crown(crown: Mesh, stem: Stem, turn_rad: float, tint: float) -> Mesh:
    """A crown prototype turned, scaled to the stem's height and bent along its axis."""
    scale = stem.height_m / CROWN_HEIGHT_M
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    vertices = (crown.vertices @ turn) * scale
    bent = stem.axis(vertices[:, 2])
    vertices[:, :2] += bent[:, :2]
    return Mesh(
        vertices, crown.normals @ turn, crown.uv, crown.tint * tint, crown.faces, crown.layer,
        crown.labelled,
    )  # fmt: skip
