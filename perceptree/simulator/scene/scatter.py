"""Where undergrowth grows and lies: clusters by kind, with rules of slope and stems nearby."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.scene.terrain import Terrain
from perceptree.simulator.settings import UndergrowthSettings
from perceptree.simulator.vectors import unit

Float = NDArray[np.floating[Any]]

RADIUS_M = 21.0
_TINT = (0.75, 1.15)


@dataclass(frozen=True)
class Placement:
    """n objects of one kind: ``position_m`` (n, 3), ``rotation`` (n, 3, 3), ``scale``, ``tint``
    and ``choice`` (n,), a number in [0, 1) that picks the variant."""

    kind: str
    position_m: Float
    rotation: Float
    scale: Float
    tint: Float
    choice: Float


@dataclass(frozen=True)
class _Habit:
    """How a kind is scattered.

    ``setting`` of UndergrowthSettings scales ``full_count`` objects within RADIUS_M; the higher
    ``threshold``, the fewer and the more clustered; ``lying`` ones follow the ground's slope.
    """

    setting: str
    full_count: int
    scale: tuple[float, float]
    threshold: float
    lying: bool = False


_HABITS = {
    "grass": _Habit("grass", 5000, (0.5, 1.3), 0.0),
    "dry_grass": _Habit("grass", 2200, (0.5, 1.2), 0.3),
    "fern": _Habit("ferns", 350, (0.5, 1.2), 0.1),
    "scrub": _Habit("scrubs", 320, (0.5, 1.4), -0.2),
    "seedling": _Habit("scrubs", 70, (0.5, 1.3), -0.3),
    "sapling": _Habit("scrubs", 26, (0.5, 1.1), -0.5),
    "branch": _Habit("branches", 260, (0.6, 1.4), -2.0, lying=True),
    "log": _Habit("branches", 12, (0.7, 1.2), -2.0, lying=True),
    "stump": _Habit("stumps", 16, (0.7, 1.2), -2.0),
    "rock": _Habit("rocks", 60, (0.4, 1.6), 0.0, lying=True),
}


def turned(turn_rad: Float) -> Float:
    """(n, 3, 3) rotations about the vertical."""
    cos, sin, zero = np.cos(turn_rad), np.sin(turn_rad), np.zeros_like(turn_rad)
    rows = [[cos, -sin, zero], [sin, cos, zero], [zero, zero, zero + 1]]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def lying(terrain: Terrain, x_m: Float, y_m: Float, turn_rad: Float) -> Float:
    """(n, 3, 3) rotations whose z axis is the ground's normal."""
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
    """Objects of every kind around the middle, denser towards it, clear of stems (n, 2)."""
    placements = []
    phase = rng.uniform(0, 2 * np.pi, 2)
    density = {
        name: rng.uniform(*getattr(settings, name))
        for name in ("grass", "ferns", "scrubs", "branches", "stumps", "rocks")
    }
    for kind, habit in _HABITS.items():
        number = int(habit.full_count * density[habit.setting])
        distance = RADIUS_M * rng.random(number) ** 0.6
        angle = rng.uniform(0, 2 * np.pi, number)
        x, y = distance * np.cos(angle), distance * np.sin(angle)
        cluster = np.sin(x * 0.8 + phase[0]) * np.cos(y * 0.7 + phase[1])
        kept = cluster + rng.normal(0, 0.45, number) > habit.threshold
        kept &= terrain.local_slope_deg(x, y) < 40.0
        if habit.full_count < 100:
            kept &= _clear(x, y, stems_m, 0.6)
        placements.append(_placement(rng, kind, habit, terrain, x[kept], y[kept]))
    return placements


def _clear(x_m: Float, y_m: Float, stems_m: Float, least_m: float) -> NDArray[np.bool_]:
    if not len(stems_m):
        return np.ones(len(x_m), np.bool_)
    gap = np.hypot(x_m[:, None] - stems_m[:, 0], y_m[:, None] - stems_m[:, 1])
    return np.asarray(gap.min(1, initial=np.inf) > least_m)


def _placement(
    rng: np.random.Generator, kind: str, habit: _Habit, terrain: Terrain, x: Float, y: Float
) -> Placement:
    turn = rng.uniform(0, 2 * np.pi, len(x))
    rotation = lying(terrain, x, y, turn) if habit.lying else turned(turn)
    return Placement(
        kind,
        np.stack([x, y, terrain.height_m(x, y)], -1),
        rotation,
        rng.uniform(*habit.scale, len(x)),
        rng.uniform(*_TINT, len(x)),
        rng.random(len(x)),
    )


def roots_at(rng: np.random.Generator, terrain: Terrain, feet_m: Float) -> Placement:
    """Surface roots around the feet (n, 2) of stems."""
    habit = _Habit("", 0, (0.7, 1.2), 0.0, lying=True)
    return _placement(rng, "root", habit, terrain, feet_m[:, 0], feet_m[:, 1])
