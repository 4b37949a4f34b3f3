"""Scatter undergrowth in clusters, with limits on slope and on the distance to stems."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from basetree.arrays import Bool, Float
from perceptree.simulator.scene.terrain import Terrain
from perceptree.simulator.settings import UndergrowthSettings
from perceptree.simulator.vectors import heading, unit

RADIUS_M = 21.0  # undergrowth is within this distance of the centre
TINT = (0.75, 1.15)  # usual range of the brightness factor


@dataclass(frozen=True)
class Placement:
    """Placed objects of one kind.

    Attributes:
        kind: Name of the kind.
        position_m: (n, 3) m.
        rotation: (n, 3, 3).
        scale: (n,) size factor.
        tint: (n,) brightness factor.
        choice: (n,) number in [0, 1) that chooses the variant.
    """

    kind: str
    position_m: Float
    rotation: Float
    scale: Float
    tint: Float
    choice: Float


@dataclass(frozen=True)
class _ScatterRule:
    """How a kind is scattered.

    `setting` of UndergrowthSettings scales `full_count` objects within RADIUS_M; the higher
    `threshold`, the fewer and the more clustered; `lying` ones follow the ground's slope.
    """

    setting: str
    full_count: int
    scale: tuple[float, float]
    threshold: float
    follows_slope: bool = False


_SCATTER_RULES = {
    "grass": _ScatterRule("grass", 5000, (0.5, 1.3), 0.0),
    "dry_grass": _ScatterRule("grass", 2200, (0.5, 1.2), 0.3),
    "fern": _ScatterRule("ferns", 350, (0.5, 1.2), 0.1),
    "scrub": _ScatterRule("scrubs", 320, (0.5, 1.4), -0.2),
    "seedling": _ScatterRule("scrubs", 70, (0.5, 1.3), -0.3),
    "sapling": _ScatterRule("scrubs", 26, (0.5, 1.1), -0.5),
    "branch": _ScatterRule("branches", 260, (0.6, 1.4), -2.0, follows_slope=True),
    "log": _ScatterRule("branches", 12, (0.7, 1.2), -2.0, follows_slope=True),
    "stump": _ScatterRule("stumps", 16, (0.7, 1.2), -2.0),
    "rock": _ScatterRule("rocks", 60, (0.4, 1.6), 0.0, follows_slope=True),
}


def place(
    rng: np.random.Generator,
    kind: str,
    terrain: Terrain,
    places_m: Float,
    scale: tuple[float, float] | Float,
    tint: tuple[float, float] = TINT,
    follows_slope: bool = False,
) -> Placement:
    """Place objects of one kind on the ground, each turned about the vertical at random.

    Args:
        rng: Source of random numbers.
        kind: Name of the kind.
        terrain: The ground.
        places_m: (n, 2) positions, m.
        scale: Range of the size factor, or (n,) factors.
        tint: Range of the brightness factor.
        follows_slope: Whether objects are aligned with the ground's slope.
    """
    x, y = places_m.T
    rotation = rotations(terrain, x, y, rng.uniform(0, 2 * np.pi, len(x)), follows_slope)
    size = rng.uniform(*scale, len(x)) if isinstance(scale, tuple) else scale
    position_m = np.stack([x, y, terrain.height_m(x, y)], -1)
    brightness = rng.uniform(*tint, len(x))
    return Placement(kind, position_m, rotation, size, brightness, rng.random(len(x)))


def rotations(
    terrain: Terrain, x_m: Float, y_m: Float, turn_rad: Float, follows_slope: bool
) -> Float:
    """(n, 3, 3) rotations by angles (n,) about the vertical, or about the ground's normal."""
    if not follows_slope:
        return yaw_rotations(turn_rad)
    return slope_rotations(terrain, x_m, y_m, turn_rad)


def yaw_rotations(turn_rad: Float) -> Float:
    """(n, 3, 3) rotations about the vertical by angles (n,)."""
    cos, sin, zero = np.cos(turn_rad), np.sin(turn_rad), np.zeros_like(turn_rad)
    rows = [[cos, -sin, zero], [sin, cos, zero], [zero, zero, zero + 1]]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def slope_rotations(terrain: Terrain, x_m: Float, y_m: Float, turn_rad: Float) -> Float:
    """(n, 3, 3) rotations by angles (n,) with the ground's normal as z axis."""
    step = 0.4
    rise_x = (terrain.height_m(x_m + step, y_m) - terrain.height_m(x_m - step, y_m)) / (2 * step)
    rise_y = (terrain.height_m(x_m, y_m + step) - terrain.height_m(x_m, y_m - step)) / (2 * step)
    up = unit(np.stack([-rise_x, -rise_y, np.ones_like(rise_x)], -1))
    along = np.stack([np.cos(turn_rad), np.sin(turn_rad), np.zeros_like(turn_rad)], -1)
    across = unit(np.cross(up, along))
    return np.stack([np.cross(across, up), across, up], -1)


def scatter(
    rng: np.random.Generator, settings: UndergrowthSettings, terrain: Terrain, stems_m: Float
) -> list[Placement]:
    """Scatter undergrowth of every kind, denser towards the scene's centre.

    Args:
        rng: Source of random numbers.
        settings: Densities.
        terrain: The ground.
        stems_m: (n, 2) positions of stems that large kinds keep clear of, m.
    """
    placements = []
    phase = rng.uniform(0, 2 * np.pi, 2)
    density = {
        name: rng.uniform(*getattr(settings, name))
        for name in ("grass", "ferns", "scrubs", "branches", "stumps", "rocks")
    }
    for kind, rule in _SCATTER_RULES.items():
        number = int(rule.full_count * density[rule.setting])
        distance = RADIUS_M * rng.random(number) ** 0.6
        angle = rng.uniform(0, 2 * np.pi, number)
        places_m = distance[:, None] * heading(angle)
        x, y = places_m.T
        cluster = np.sin(x * 0.8 + phase[0]) * np.cos(y * 0.7 + phase[1])
        kept = cluster + rng.normal(0, 0.45, number) > rule.threshold
        kept &= terrain.local_slope_deg(x, y) < 40.0
        if rule.full_count < 100:
            kept &= _clear(x, y, stems_m, 0.6)
        placements.append(
            place(rng, kind, terrain, places_m[kept], rule.scale, follows_slope=rule.follows_slope)
        )
    return placements


def _clear(x_m: Float, y_m: Float, stems_m: Float, least_m: float) -> Bool:
    if not len(stems_m):
        return np.ones(len(x_m), np.bool_)
    gap = np.hypot(x_m[:, None] - stems_m[:, 0], y_m[:, None] - stems_m[:, 1])
    return np.asarray(gap.min(1, initial=np.inf) > least_m)


def scatter_roots(rng: np.random.Generator, terrain: Terrain, feet_m: Float) -> Placement:
    """Place surface roots around the feet (n, 2) of stems."""
    return place(rng, "root", terrain, feet_m, (0.7, 1.2), follows_slope=True)
