"""A closed way through the middle of a scene, which a machine drives around."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.floating[Any]]

_POINTS = 2048
_RADIUS_M = (3.5, 5.5)
_WAVES = 4
_WAVE = 0.22


@dataclass(frozen=True)
class Circuit:
    """``points_m`` (n, 2) of a closed curve, every one ``step_m`` further along it."""

    points_m: Float
    step_m: float

    @property
    def length_m(self) -> float:
        """Once around."""
        return len(self.points_m) * self.step_m

    def at(self, way_m: Float) -> Float:
        """(..., 2) points after ``way_m`` metres along the curve, over and over."""
        place = np.asarray(way_m) / self.step_m
        low = np.floor(place).astype(int)
        rest = (place - low)[..., None]
        points, count = self.points_m, len(self.points_m)
        return np.asarray(points[low % count] * (1 - rest) + points[(low + 1) % count] * rest)

    def distance_m(self, places_m: Float) -> Float:
        """(n,) distances of places (n, 2) from the curve."""
        if not len(places_m):
            return np.zeros(0)
        gaps = np.linalg.norm(places_m[:, None] - self.points_m[::8], axis=-1)
        return np.asarray(gaps.min(1))


def make_circuit(rng: np.random.Generator) -> Circuit:
    """A round curve of random waves, so near the middle that all within 10 m of it is drawn in
    full."""
    angle = np.linspace(0, 2 * np.pi, 4 * _POINTS, endpoint=False)
    radius = np.full_like(angle, rng.uniform(*_RADIUS_M))
    shape = np.ones_like(angle)
    for wave in range(2, 2 + _WAVES):
        shape += _WAVE / wave * rng.normal() * np.cos(wave * angle + rng.uniform(0, 2 * np.pi))
    curve = (radius * np.clip(shape, 0.5, 1.4))[:, None]
    curve = curve * np.stack([np.cos(angle), np.sin(angle)], -1)
    closed = np.concatenate([curve, curve[:1]])
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    even = np.arange(_POINTS) * along[-1] / _POINTS
    points = np.stack([np.interp(even, along, closed[:, axis]) for axis in (0, 1)], -1)
    return Circuit(points, float(along[-1] / _POINTS))
