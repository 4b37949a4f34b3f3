"""A closed path around the centre of a scene, which a machine drives along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.vectors import heading

_POINTS = 2048
_RADIUS_M = (3.5, 5.5)  # range of the mean radius
_WAVES = 4  # number of waves that deform the circle
_WAVE_AMPLITUDE = 0.22  # standard deviation of their amplitude times their number of periods


@dataclass(frozen=True)
class Circuit:
    """A closed path.

    Attributes:
        points_m: (n, 2) points at equal distances along the path, m.
        step_m: Distance between neighbouring points along the path, m.
    """

    points_m: Float
    step_m: float

    @property
    def length_m(self) -> float:
        """Length of the path, m."""
        return len(self.points_m) * self.step_m

    def points_at(self, distance_m: Float) -> Float:
        """(..., 2) points at distances along the path, m; after one lap it starts again."""
        position = np.asarray(distance_m) / self.step_m
        low = np.floor(position).astype(int)
        rest = (position - low)[..., None]
        points, count = self.points_m, len(self.points_m)
        return np.asarray(points[low % count] * (1 - rest) + points[(low + 1) % count] * rest)

    def distance_m(self, places_m: Float) -> Float:
        """(n,) distances of points (n, 2) from the path, m."""
        if not len(places_m):
            return np.zeros(0)
        gaps = np.linalg.norm(places_m[:, None] - self.points_m[::8], axis=-1)
        return np.asarray(gaps.min(1))


def make_circuit(rng: np.random.Generator) -> Circuit:
    """Make a random closed path.

    It stays so close to the scene's centre that everything within 10 m of it has full detail.
    """
    angle = np.linspace(0, 2 * np.pi, 4 * _POINTS, endpoint=False)
    radius = np.full_like(angle, rng.uniform(*_RADIUS_M))
    shape = np.ones_like(angle)
    for wave in range(2, 2 + _WAVES):
        shape += (
            _WAVE_AMPLITUDE / wave * rng.normal() * np.cos(wave * angle + rng.uniform(0, 2 * np.pi))
        )
    curve = (radius * np.clip(shape, 0.5, 1.4))[:, None]
    curve = curve * heading(angle)
    closed = np.concatenate([curve, curve[:1]])
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    even = np.arange(_POINTS) * along[-1] / _POINTS
    points = np.stack([np.interp(even, along, closed[:, axis]) for axis in (0, 1)], -1)
    return Circuit(points, float(along[-1] / _POINTS))
