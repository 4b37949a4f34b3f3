"""Where things that are no trees stand: anywhere small ones, apart from the camera large ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.scene.scatter import Placement, lying, turned
from perceptree.simulator.scene.terrain import Terrain
from perceptree.simulator.settings import ObjectSettings

Float = NDArray[np.floating[Any]]

_RADIUS_M = 18.0
_CAMERAS_M = 7.0
_STEM_M = 0.4
_LARGE_M = 1.0
_TRIES = 20


@dataclass(frozen=True)
class _Kind:
    """``setting`` of ObjectSettings counts a kind; ``wide_m`` is the radius that it needs."""

    setting: str
    wide_m: float
    scale: tuple[float, float]
    lying: bool = False


_KINDS = {
    "person": _Kind("people", 0.4, (1.0, 1.0)),
    "animal": _Kind("animals", 0.7, (0.9, 1.1)),
    "machine": _Kind("machines", 3.0, (0.8, 1.1), lying=True),
    "post": _Kind("posts", 0.15, (0.8, 1.2)),
    "timber": _Kind("logs", 0.8, (0.8, 1.2), lying=True),
    "wall": _Kind("walls", 1.5, (0.8, 1.2)),
    "shape": _Kind("shapes", 0.5, (0.6, 1.4)),
}
OBJECT_KINDS = tuple(_KINDS)


@dataclass(frozen=True)
class Objects:
    """What stands about: its placements, and the circles (n, 3), x, y and radius in metres, that
    a camera has to keep out of."""

    placements: list[Placement]
    circles: Float


def place_large(
    rng: np.random.Generator, settings: ObjectSettings, terrain: Terrain, taken_m: Float
) -> Objects:
    """Machines and walls, beyond where cameras stand and clear of places (n, 2) that are taken.

    Stems within their circles have to go.
    """
    return _place(rng, settings, terrain, taken_m, np.empty((0, 3)), large=True)


def place_small(
    rng: np.random.Generator,
    settings: ObjectSettings,
    terrain: Terrain,
    taken_m: Float,
    circles: Float,
) -> Objects:
    """All other objects, clear of stems and other places (n, 2) and of circles (n, 3)."""
    return _place(rng, settings, terrain, taken_m, circles, large=False)


def _place(
    rng: np.random.Generator,
    settings: ObjectSettings,
    terrain: Terrain,
    taken_m: Float,
    circles: Float,
    large: bool,
) -> Objects:
    """Draw how many of each kind, and where: clear of each other."""
    placements = []
    for name, kind in _KINDS.items():
        if (kind.wide_m >= _LARGE_M) != large:
            continue
        places = []
        for _ in range(round(rng.uniform(*getattr(settings, kind.setting)))):
            place = _free_place(rng, kind.wide_m, taken_m, circles)
            if place is not None:
                places.append(place)
                circles = np.concatenate([circles, [[*place, kind.wide_m]]])
        if places:
            placements.append(_placement(rng, name, kind, terrain, np.array(places)))
    return Objects(placements, circles)


def _free_place(
    rng: np.random.Generator, wide_m: float, taken_m: Float, circles: Float
) -> Float | None:
    """(2,) a place with nothing within the radius, if one is found."""
    nearest_m = 0.0 if wide_m < _LARGE_M else _CAMERAS_M + wide_m
    for _ in range(_TRIES):
        distance = np.sqrt(rng.uniform(nearest_m**2, _RADIUS_M**2))
        angle = rng.uniform(0, 2 * np.pi)
        place = distance * np.array([np.cos(angle), np.sin(angle)])
        free_m = np.hypot(*(taken_m - place).T) - _STEM_M
        apart_m = np.hypot(*(circles[:, :2] - place).T) - circles[:, 2]
        if min(free_m.min(initial=np.inf), apart_m.min(initial=np.inf)) > wide_m:
            return np.asarray(place)
    return None


def _placement(
    rng: np.random.Generator, name: str, kind: _Kind, terrain: Terrain, places: Float
) -> Placement:
    x, y = places.T
    turn = rng.uniform(0, 2 * np.pi, len(x))
    rotation = lying(terrain, x, y, turn) if kind.lying else turned(turn)
    return Placement(
        name,
        np.stack([x, y, terrain.height_m(x, y)], -1),
        rotation,
        rng.uniform(*kind.scale, len(x)),
        rng.uniform(0.7, 1.2, len(x)),
        rng.random(len(x)),
    )
