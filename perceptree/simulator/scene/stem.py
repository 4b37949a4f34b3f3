"""Analytic stem shapes: axis, radius and girth by height. Labels and meshes are both made of them.

Shape parameters without a source were chosen by eye.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from basetree.arrays import Float
from perceptree.simulator.scene.models import TreeModel
from perceptree.simulator.vectors import heading, unit

BREAST_HEIGHT_M = 1.3
LOWEST_FORK_M = 1.6
HIGHEST_FORK_M = 6.0
_GIRTH_POINTS = 192
_TIP_SHARE = 0.02  # radius at the tip as a fraction of that at the foot
_SWELL_M = 0.9  # height over which the lower stem's widening decreases by a factor of e
_SWELL = 0.12  # widening at the foot, as a fraction of the radius
_FOOT_SWEEP_M = 1.1  # height over which the foot's curve decreases by a factor of e
_FORK_BEND_M = 2.2  # height over which the second leader becomes parallel


@dataclass(frozen=True)
class Fork:
    """A second leader of a stem.

    Attributes:
        height_m: Height above the foot where it splits off, m.
        azimuth_rad: Direction in which it splits off.
        angle_rad: Angle from the main leader at the split; within a few metres it becomes parallel.
        radius_share: Its radius as a fraction of the main leader's.
        top_m: Height of its tip above the foot, m.
    """

    height_m: float
    azimuth_rad: float
    angle_rad: float
    radius_share: float
    top_m: float


@dataclass(frozen=True)
class Stem:
    """The shape of a stem with its foot at the origin and z up.

    Attributes:
        model: Its tree model.
        diameter_m: Diameter at breast height without irregularities, m.
        height_m: Height of the unbroken stem, m.
        lean: (2,) tangent of the lean along x and y.
        sweep_m: (2,) amplitude of the bends along x and y, m.
        sweep_phase: (2,) phase of the bends, rad.
        foot_sweep_m: (2,) sideways curve of the foot, m.
        roots: (k, 4) ridges of the root collar: azimuth (rad), widening as a fraction of the
            radius, narrowness, and height (m).
        bumps: (k, 4) irregularities of the cross-section: amplitude as a fraction of the radius,
            waves around the stem, twist (rad/m), and phase (rad).
        fork: Second leader, or None.
        broken_m: Height above the foot where the stem is broken, m; None if it is not.
    """

    model: TreeModel
    diameter_m: float
    height_m: float
    lean: Float
    sweep_m: Float
    sweep_phase: Float
    foot_sweep_m: Float
    roots: Float
    bumps: Float
    fork: Fork | None = None
    broken_m: float | None = None

    @property
    def species(self) -> str:
        """Species of the model."""
        return self.model.species

    def axis(self, height_m: Float) -> Float:
        """(..., 3) points of the axis at heights above the foot, m."""
        level = height_m[..., None]
        wave = np.sin(level / 3.3 + self.sweep_phase) - np.sin(self.sweep_phase)
        foot = 1 - np.exp(-np.maximum(level, -1.0) / _FOOT_SWEEP_M)
        across = self.lean * level + self.sweep_m * wave + self.foot_sweep_m * foot
        return np.concatenate([across, level], -1)

    def direction(self, height_m: float) -> Float:
        """(3,) unit vector along the axis, upwards."""
        ends = self.axis(np.array([height_m - 0.01, height_m + 0.01]))
        return unit(ends[1] - ends[0])

    def radius_m(self, height_m: Float, angle_rad: Float) -> Float:
        """(heights, angles) radius of the bark, m."""
        shape = np.ones((len(height_m), len(angle_rad)))
        for azimuth, swelling, narrowness, reach_m in self.roots:
            ridge = np.exp(narrowness * (np.cos(angle_rad - azimuth) - 1))
            fading = 2 / (1 + np.exp(np.minimum(height_m / reach_m, 60.0)))
            shape += swelling * fading[:, None] * ridge
        for amplitude, turns, waves, phase in self.bumps:
            turn = np.round(turns) * angle_rad[None] + waves * height_m[:, None] + phase
            shape += amplitude * np.sin(turn)
        return np.asarray(0.5 * self.diameter_m * self._taper(height_m)[:, None] * shape)

    def _taper(self, height_m: Float) -> Float:
        """(heights,) mean radius over that at breast height, without the root collar."""

        def trunk(level: Float) -> Float:
            left = np.maximum(1 - level / self.height_m, 0.0) ** self.model.taper
            swell = 1 + _SWELL * np.exp(-np.maximum(level, 0.0) / _SWELL_M)
            return np.asarray((_TIP_SHARE + (1 - _TIP_SHARE) * left) * swell)

        taper = trunk(height_m) / trunk(np.array(BREAST_HEIGHT_M))
        if self.fork:
            rise = np.clip((height_m - self.fork.height_m + 0.2) / 0.9, 0.0, 1.0)
            taper *= 1 - 0.2 * self.fork.radius_share * rise * rise * (3 - 2 * rise)
        return np.asarray(taper)

    def rings(self, height_m: Float, sides: int) -> Float:
        """(heights, sides + 1, 3) points of the bark on sections perpendicular to the axis, m."""
        angle = np.linspace(0.0, 2 * np.pi, sides + 1)
        return _rings(self.axis, height_m, self.radius_m(height_m, angle), angle)

    def fork_axis(self, height_m: Float) -> Float:
        """(..., 3) points of the second leader's axis at heights above the foot, m.

        Raises:
            ValueError: If the stem has no fork.
        """
        if self.fork is None:
            raise ValueError("the stem has no fork")
        way = np.maximum(height_m - self.fork.height_m, 0.0)
        aside = np.tan(self.fork.angle_rad) * _FORK_BEND_M * (1 - np.exp(-way / _FORK_BEND_M))
        towards = np.array([np.cos(self.fork.azimuth_rad), np.sin(self.fork.azimuth_rad), 0.0])
        return np.asarray(self.axis(height_m) + aside[..., None] * towards)

    def fork_rings(self, height_m: Float, sides: int) -> Float:
        """(heights, sides + 1, 3) points of the second leader's bark, m.

        Raises:
            ValueError: If the stem has no fork.
        """
        if self.fork is None:
            raise ValueError("the stem has no fork")
        angle = np.linspace(0.0, 2 * np.pi, sides + 1)
        left = (self.fork.top_m - height_m) / (self.fork.top_m - self.fork.height_m)
        start_m = self.radius_m(np.array([self.fork.height_m]), angle) * self.fork.radius_share
        radius = start_m * np.clip(left, _TIP_SHARE, 1.0)[:, None] ** self.model.taper
        return _rings(self.fork_axis, height_m, radius, angle)

    def girth_diameter_m(self, height_m: float) -> float:
        """Diameter that a tape measures, m: convex girth of the cross-section over pi."""
        ring = self.rings(np.array([height_m]), _GIRTH_POINTS)[0] - self.axis(np.array(height_m))
        axis = self.direction(height_m)
        first = unit(np.cross(np.array([0.0, 1.0, 0.0]), axis))
        flat = np.stack([ring @ first, ring @ np.cross(axis, first)], -1).astype(np.float32)
        return float(cv2.arcLength(cv2.convexHull(flat), True)) / np.pi


def _rings(
    axis: Callable[[Float], Float], height_m: Float, radius_m: Float, angle_rad: Float
) -> Float:
    """(heights, angles, 3) points at radii (heights, angles) on sections across an axis, m."""
    tangent = unit(axis(height_m + 0.01) - axis(height_m - 0.01))
    first = unit(np.cross(np.array([0.0, 1.0, 0.0]), tangent))
    second = np.cross(tangent, first)
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    across = cos * first[:, None] + sin * second[:, None]
    return np.asarray(axis(height_m)[:, None] + across * radius_m[..., None])


def random_stem(
    rng: np.random.Generator,
    model: TreeModel,
    diameter_m: float,
    lean_std_deg: float,
    lean_max_deg: float,
    fork_share: float,
) -> Stem:
    """Draw a stem of a given diameter at breast height.

    Its height follows the height curve of Meyer (1940) for even-aged stands,
    1.3 m + a (1 - exp(-b d)), with random variation.

    Args:
        rng: Source of random numbers.
        model: Its tree model.
        diameter_m: Diameter at breast height, m.
        lean_std_deg: Standard deviation of the normal distribution whose absolute value is the
            lean.
        lean_max_deg: Maximum lean.
        fork_share: Probability of a fork, multiplied by the model's factor.
    """
    grown = 1 - np.exp(-5.2 * diameter_m)
    height_m = BREAST_HEIGHT_M + (model.height_m - BREAST_HEIGHT_M) * grown * rng.uniform(0.86, 1.1)
    lean_deg = min(abs(rng.normal(0, lean_std_deg * model.lean)), lean_max_deg)
    sweep_m = model.sweep_m * min(1.0, height_m / 15)
    return Stem(
        model,
        diameter_m,
        float(height_m),
        np.tan(np.radians(lean_deg)) * heading(rng.uniform(0, 2 * np.pi)),
        rng.normal(0, 0.7 * sweep_m, 2),
        rng.uniform(0, 2 * np.pi, 2),
        rng.normal(0, 0.5 * sweep_m, 2),
        _roots(rng, model, diameter_m),
        _bumps(rng, model),
        _fork(rng, model, float(height_m)) if rng.random() < fork_share * model.fork else None,
    )


def _roots(rng: np.random.Generator, model: TreeModel, diameter_m: float) -> Float:
    """Draw the root collar: a uniform widening, and ridges that reach higher on thick stems."""
    count = int(rng.integers(4, 8))
    flare, reach_m = rng.uniform(*model.flare), 0.05 + 0.22 * diameter_m
    ridges = np.stack(
        [
            (np.arange(count) + rng.uniform(-0.35, 0.35, count)) * 2 * np.pi / count,
            flare * rng.uniform(0.3, 1.2, count),
            rng.uniform(4.0, 14.0, count),
            reach_m * rng.uniform(0.8, 1.6, count),
        ],
        -1,
    )
    collar = np.array([[0.0, 0.45 * flare, 0.0, reach_m]])
    return np.concatenate([collar, ridges])


def _bumps(rng: np.random.Generator, model: TreeModel) -> Float:
    count = 6
    turns = rng.integers(2, 7, count).astype(float)
    amplitude = rng.normal(0, model.bumps, count) * 2 / turns
    return np.stack(
        [amplitude, turns, rng.normal(0, 1.6, count), rng.uniform(0, 2 * np.pi, count)], -1
    )


def _fork(rng: np.random.Generator, model: TreeModel, height_m: float) -> Fork | None:
    highest_m = min(HIGHEST_FORK_M, 0.6 * height_m)
    if highest_m < LOWEST_FORK_M:
        return None
    return Fork(
        float(rng.uniform(LOWEST_FORK_M, highest_m)),
        float(rng.uniform(0, 2 * np.pi)),
        float(rng.uniform(0.2, 0.4 if model.conifer else 0.6)),
        float(rng.uniform(0.5, 0.9)),
        float(height_m * rng.uniform(0.78, 0.95)),
    )
