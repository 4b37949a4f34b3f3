"""Positions of objects that are not trees. Large ones keep clear of the cameras' area."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.scene.scatter import Placement, place
from perceptree.simulator.scene.terrain import Terrain
from perceptree.simulator.settings import ObjectSettings
from perceptree.simulator.vectors import heading

_RADIUS_M = 18.0  # objects are within this distance of the centre
_CAMERA_AREA_RADIUS_M = 7.0  # large objects keep clear of this area
_STEM_CLEARANCE_M = 0.4
_LARGE_RADIUS_M = 1.0  # objects of at least this radius are large
_ATTEMPTS = 20
_TINT = (0.7, 1.2)  # range of the brightness factor


@dataclass(frozen=True)
class _ObjectKind:
    """How a kind of object is placed.

    Attributes:
        setting: Field of ObjectSettings with the number of objects.
        radius_m: Radius that an object needs, m.
        scale: Range of the size factor.
        follows_slope: Whether objects are aligned with the ground's slope.
    """

    setting: str
    radius_m: float
    scale: tuple[float, float]
    follows_slope: bool = False


_KINDS = {
    "person": _ObjectKind("people", 0.4, (1.0, 1.0)),
    "animal": _ObjectKind("animals", 0.7, (0.9, 1.1)),
    "machine": _ObjectKind("machines", 3.0, (0.8, 1.1), follows_slope=True),
    "post": _ObjectKind("posts", 0.15, (0.8, 1.2)),
    "timber": _ObjectKind("logs", 0.8, (0.8, 1.2), follows_slope=True),
    "wall": _ObjectKind("walls", 1.5, (0.8, 1.2)),
    "shape": _ObjectKind("shapes", 0.5, (0.6, 1.4)),
}
OBJECT_KINDS = tuple(_KINDS)


@dataclass(frozen=True)
class Objects:
    """Placed objects.

    Attributes:
        placements: Placements by kind.
        circles: (n, 3) circles that cameras avoid: x, y and radius, m.
    """

    placements: list[Placement]
    circles: Float


def place_objects(
    rng: np.random.Generator,
    settings: ObjectSettings,
    terrain: Terrain,
    taken_m: Float,
    circles: Float,
    large: bool,
) -> Objects:
    """Draw number and positions of the large kinds, or of all others, clear of each other.

    Large objects, machines and walls, are outside the cameras' area; the caller removes the stems
    within their circles.

    Args:
        rng: Source of random numbers.
        settings: Numbers of objects.
        terrain: The ground.
        taken_m: (n, 2) points to keep clear of, such as stems, m.
        circles: (m, 3) circles to keep clear of: x, y and radius, m.
        large: Whether to place the large kinds.
    """
    placements = []
    for name, kind in _KINDS.items():
        if (kind.radius_m >= _LARGE_RADIUS_M) != large:
            continue
        positions = []
        for _ in range(round(rng.uniform(*getattr(settings, kind.setting)))):
            position = _free_position(rng, kind.radius_m, taken_m, circles)
            if position is not None:
                positions.append(position)
                circles = np.concatenate([circles, [[*position, kind.radius_m]]])
        if positions:
            places_m = np.array(positions)
            placements.append(
                place(rng, name, terrain, places_m, kind.scale, _TINT, kind.follows_slope)
            )
    return Objects(placements, circles)


def _free_position(
    rng: np.random.Generator, radius_m: float, taken_m: Float, circles: Float
) -> Float | None:
    """Draw a point (2,) with nothing within the radius; None if no attempt succeeds."""
    nearest_m = 0.0 if radius_m < _LARGE_RADIUS_M else _CAMERA_AREA_RADIUS_M + radius_m
    for _ in range(_ATTEMPTS):
        distance = np.sqrt(rng.uniform(nearest_m**2, _RADIUS_M**2))
        angle = rng.uniform(0, 2 * np.pi)
        position = distance * heading(angle)
        free_m = np.hypot(*(taken_m - position).T) - _STEM_CLEARANCE_M
        apart_m = np.hypot(*(circles[:, :2] - position).T) - circles[:, 2]
        if min(free_m.min(initial=np.inf), apart_m.min(initial=np.inf)) > radius_m:
            return np.asarray(position)
    return None
