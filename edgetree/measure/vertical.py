"""The vertical at each stem: given, or estimated from other stems, the ground and the camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from basetree.arrays import Bool, Float
from calib.directions import CAMERA_UP, unit
from edgetree.measure.constants.ground import (
    CAMERA_UP_STD_DEG,
    MIN_STEMS_FOR_VERTICAL,
    SLOPE_STD_DEG,
)
from edgetree.measure.constants.stems import COMMON_LEAN_STD_DEG
from edgetree.measure.section import StemAxes

# Stems further from the common direction than this many standard deviations count less (Huber).
_HUBER_STDS, _HUBER_ROUNDS = 1.5, 4


@dataclass(frozen=True, eq=False)
class Vertical:
    """The vertical at one stem.

    Attributes:
        up: (3,) unit vector away from gravity, in camera coordinates.
        covariance: (3, 3) of its error, in rad².
        stems: Number of other stems that it is estimated from; None if it is given.
        from_ground: Whether it is also estimated from the slope of the ground.
    """

    up: Float
    covariance: Float
    stems: int | None
    from_ground: bool

    def stds_rad(self, directions: Float) -> list[float]:
        """Standard deviations of its angle towards (D, 3) unit directions."""
        variances = np.vecdot(directions @ self.covariance, directions).tolist()
        return [math.sqrt(max(variance, 0.0)) for variance in variances]

    @property
    def tilt_std_rad(self) -> float:
        """Standard deviation of its angle, averaged over all horizontal directions."""
        return math.sqrt(max(float(self.covariance.trace()), 0.0) / 2)

    @property
    def shows_leans(self) -> bool:
        """Whether it is certain enough for the inclination of a stem."""
        return self.has_directions or self.from_ground

    @property
    def has_directions(self) -> bool:
        """Whether it is certain enough for the direction of a lean."""
        return self.stems is None or self.stems >= MIN_STEMS_FOR_VERTICAL

    def turned(self, rotation: Float) -> Vertical:
        """The same in other axes, by a rotation (3, 3) to them."""
        covariance = rotation @ self.covariance @ rotation.T
        return replace(self, up=rotation @ self.up, covariance=covariance)

    def description(self) -> str:
        """Where it comes from, as text."""
        if self.stems is None:
            return "the given vertical"
        sources = [f"{self.stems} other stem{'s' if self.stems > 1 else ''}"] * (self.stems > 0)
        sources += ["the ground's slope"] * self.from_ground + ["the camera's own up"]
        known = " and ".join([", ".join(sources[:-1]), sources[-1]] if sources[1:] else sources)
        return f"a vertical estimated from {known} (± {math.degrees(self.tilt_std_rad):.0f}°)"


@dataclass(frozen=True, eq=False)
class Verticals:
    """The verticals of T stems.

    Attributes:
        common: (3,) unit vector, the best vertical before the ground is known.
        covariance: (3, 3) of a given vertical's error, in rad²; None if it is estimated.
        stem_information: (T, 3, 3) what each stem's axis tells of the vertical: the inverse
            covariance of its direction as the vertical's, times its robust weight. None if the
            vertical is given.
        counted: (T,) whether the stem's axis is used.
        camera_up: (3,) the camera's own up.
    """

    common: Float
    covariance: Float | None = None
    stem_information: Float | None = None
    counted: Bool | None = None
    camera_up: Float = field(default_factory=lambda: np.array(CAMERA_UP))

    @classmethod
    def from_stems(
        cls, axes: StemAxes, roll_std_rad: Float, tilt_std_rad: Float, lean_std_rad: float
    ) -> Verticals:
        """Estimate the vertical from the directions of stems, and the camera's own up.

        A weighted least squares fit with Huber's weights, which trust a leaning stem less.

        Args:
            axes: (T) coordinate systems of the stems.
            roll_std_rad: (T,) standard deviations of the axes' angles within the image; infinite
                for stems that are not to be used.
            tilt_std_rad: (T,) the same towards or away from the camera.
            lean_std_rad: Standard deviation of a stem's lean.
        """
        roll, tilt = (
            1 / (lean_std_rad**2 + std_rad**2)[:, None, None]
            for std_rad in (roll_std_rad, tilt_std_rad)
        )
        information = _outer(axes.across) * roll + _outer(axes.away) * tilt
        counted = np.isfinite(roll_std_rad) & np.isfinite(information).all(axis=(1, 2))
        information = np.where(counted[:, None, None], information, 0.0)
        matrix, vector = _camera(np.array(CAMERA_UP))
        weight = np.ones(len(roll_std_rad))
        for _ in range(_HUBER_ROUNDS):
            common = _solved(matrix + (weight[:, None, None] * information).sum(0), vector)
            apart = np.sqrt((information @ common) @ common)
            weight = _HUBER_STDS / np.maximum(apart, _HUBER_STDS)
        # Few stems may all lean.
        if counted.sum() < MIN_STEMS_FOR_VERTICAL:
            common = np.array(CAMERA_UP)
        return cls(common, None, weight[:, None, None] * information, np.asarray(counted))

    def beginning_with(self, first: int) -> Verticals:
        """The same with stem number `first` as number 0, and those before it at the end."""
        if first == 0 or self.stem_information is None or self.counted is None:
            return self
        information = np.roll(self.stem_information, -first, axis=0)
        return replace(self, stem_information=information, counted=np.roll(self.counted, -first))

    def turned(self, rotation: Float) -> Verticals:
        """The same in other axes, by a rotation (3, 3) to them."""

        def around(matrices: Float | None) -> Float | None:
            return None if matrices is None else np.asarray(rotation @ matrices @ rotation.T)

        return replace(
            self,
            common=rotation @ self.common,
            covariance=around(self.covariance),
            stem_information=around(self.stem_information),
            camera_up=rotation @ self.camera_up,
        )

    def at(self, index: int, normal: Float | None) -> Vertical:
        """The vertical at one stem. The stem's own direction is left out.

        Args:
            index: Number of the stem.
            normal: (3,) normal of the ground there, if it is known.
        """
        if self.stem_information is None or self.counted is None:
            covariance = np.zeros((3, 3)) if self.covariance is None else self.covariance
            return Vertical(self.common, covariance, None, False)
        others = self.stem_information.sum(0) - self.stem_information[index]
        # The common lean of the stand limits what many stems tell.
        common_lean = math.radians(COMMON_LEAN_STD_DEG) ** 2
        others = others @ np.linalg.inv(np.eye(3) + common_lean * others)
        matrix, vector = _camera(self.camera_up)
        matrix = matrix + others
        if normal is not None:
            slope = math.radians(SLOPE_STD_DEG) ** 2
            matrix = matrix + np.eye(3) / slope
            vector = vector + normal / slope
        up = _solved(matrix, vector)
        level = np.eye(3) - np.outer(up, up)
        covariance = level @ np.linalg.inv(matrix) @ level
        stems = int(self.counted.sum()) - int(self.counted[index])
        return Vertical(up, covariance, stems, normal is not None)


def _outer(vectors: Float) -> Float:
    """(T, 3, 3) outer products of (T, 3) vectors with themselves."""
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])


def _camera(up: Float) -> tuple[Float, Float]:
    """Information matrix (3, 3) and vector (3,) of the camera's own up direction (3,)."""
    variance = math.radians(CAMERA_UP_STD_DEG) ** 2
    return np.eye(3) / variance, up / variance


def _solved(matrix: Float, vector: Float) -> Float:
    """(3,) unit vector that solves the normal equations."""
    return unit(np.linalg.solve(matrix, vector))
