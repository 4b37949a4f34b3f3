"""Where the camera is in the map, and how it moves."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from basetree.arrays import Float
from calib import RigidTransform
from edgetree.live.tracking.plane import place_jacobian, wrapped
from edgetree.live.tracking.settings import TrackingSettings

# Standard deviation of the change of the camera's height, m per square root of a second.
_CLIMB_M = 0.15
# Standard deviations of a place and heading that a search found.
_FOUND_STD_M, _FOUND_STD_DEG = 0.3, 5.0
# After this long without any knowledge of the motion, a longer time changes nothing.
_MAX_STEP_S = 10.0
# Place in x and y and heading, among shifts in x, y and z and the turn.
_LEVEL = (0, 1, 3)


class CameraMotion:
    """Place, heading and speed of the camera on the level plane of the map.

    A Kalman filter with constant velocity between the frames; the noise is a white acceleration.

    Attributes:
        source: What the latest place is from: "start" for a new map, "pose", "stems", "depth" for
            registered depth images, or "prediction" by the speed.
        state: (6,) x m, y m, heading rad, and their rates per second.
        covariance: (6, 6) of its error.
        height_m: Height of the camera in the map.
        height_variance: Variance of its error, m².
    """

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        self.restart()

    def restart(self) -> None:
        """Make the camera's present place the origin of a map."""
        self.source: Literal["start", "pose", "stems", "depth", "prediction"] = "start"
        self.state: Float = np.zeros(6)
        self.height_m = 0.0
        self.height_variance = 0.0
        self.covariance = np.diag([1e-8, 1e-8, 1e-8, *self._rates()])

    def _rates(self) -> tuple[float, float, float]:
        speed = self._settings.speed_m_per_s**2
        return speed, speed, math.radians(self._settings.turn_deg_per_s) ** 2

    def forget_speed(self) -> None:
        """The speed is not known any more, as after a jump of the clock."""
        place = self.covariance[:3, :3]
        self.state = np.concatenate([self.state[:3], np.zeros(3)])
        self.covariance = np.diag([0.0, 0.0, 0.0, *self._rates()])
        self.covariance[:3, :3] = place

    @property
    def place_std_m(self) -> float:
        """Standard deviation of the place, of both coordinates together."""
        return math.sqrt(float(np.trace(self.covariance[:2, :2])))

    def _spread(self, step_s: float) -> Float:
        """(6, 3) deviations of place, heading and their rates by the acceleration in a time."""
        acceleration = np.array(
            [
                self._settings.acceleration_m_per_s2,
                self._settings.acceleration_m_per_s2,
                math.radians(self._settings.turn_acceleration_deg_per_s2),
            ]
        )
        by_time = np.concatenate([np.eye(3) * step_s**2 / 2, np.eye(3) * step_s])
        return np.asarray(by_time * acceleration)

    def predict(self, step_s: float) -> None:
        """Move on by a time."""
        step_s = min(step_s, _MAX_STEP_S)
        move = np.eye(6)
        move[:3, 3:] = step_s * np.eye(3)
        spread = self._spread(step_s)
        self.state = move @ self.state
        self.covariance = move @ self.covariance @ move.T + spread @ spread.T
        # A speed that was never seen is bounded all the same.
        self.covariance[3:, 3:] += 1e-9 * np.eye(3)
        self.height_variance += _CLIMB_M**2 * step_s
        self.source = "prediction"

    def expected_step(self, step_s: float) -> tuple[RigidTransform, Float]:
        """The step that constant velocity leads to.

        Returns:
            The transform from the level frame now to the one before, and the (4, 4) covariance of
            the error of its shift in x, y and z, m, and of its turn, rad.
        """
        turn_rad = self.state[5] * step_s
        cos, sin = math.cos(turn_rad), math.sin(turn_rad)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        shift_m = np.array([*(self.rotation().T @ self.state[3:5] * step_s), 0.0])
        spread = self._spread(step_s)[:3]
        rates = step_s**2 * self.covariance[3:, 3:] + spread @ spread.T
        to_level = np.eye(3)
        to_level[:2, :2] = self.rotation().T
        covariance = np.diag([0.0, 0.0, _CLIMB_M**2 * step_s, 0.0])
        covariance[np.ix_(_LEVEL, _LEVEL)] = to_level @ rates @ to_level.T
        return RigidTransform(turn, shift_m), covariance

    def advance(self, step: RigidTransform, covariance: Float, step_s: float | None) -> None:
        """Move on by a measured step.

        Args:
            step: Transform from the level frame now to the one before.
            covariance: (4, 4) of the error of its shift in x, y and z, m, and of its turn, rad.
            step_s: Time that it took; None if that is not known.
        """
        turn = self.rotation()
        heading_rad = math.atan2(step.rotation[1, 0], step.rotation[0, 0])
        carried = np.eye(3)
        carried[:2] = self.place_jacobian(step.translation_m[None, :2])[0]
        turned = np.eye(3)
        turned[:2, :2] = turn
        error = turned @ covariance[np.ix_(_LEVEL, _LEVEL)] @ turned.T
        moved = np.array([*(turn @ step.translation_m[:2]), heading_rad])
        place = carried @ self.covariance[:3, :3] @ carried.T + error
        self.state[:3] += moved
        self.height_m += float(step.translation_m[2])
        self.height_variance += float(covariance[2, 2])
        self.covariance = np.diag([0.0, 0.0, 0.0, *self._rates()])
        self.covariance[:3, :3] = place
        if step_s:
            self.state[3:] = moved / step_s
            self.covariance[3:, 3:] = 2 * error / step_s**2
        self.source = "depth"

    def set_pose(self, place_m: Float, heading_rad: float, step_s: float | None) -> None:
        """Take a given pose; `step_s` since the last one, None if there was none."""
        there = np.array([place_m[0], place_m[1], heading_rad])
        if step_s:
            moved = there - self.state[:3]
            moved[2] = wrapped(moved[2])
            self.state[3:] = moved / step_s
        self.state[:3] = there
        place, turn = self._settings.pose_std_m**2, math.radians(self._settings.pose_std_deg) ** 2
        self.covariance = np.diag([place, place, turn, *self._rates()])
        if step_s:
            self.covariance[3:, 3:] = np.diag([place, place, turn]) * 2 / step_s**2
        self.height_m, self.height_variance = float(place_m[2]), place
        self.source = "pose"

    def take_found(self, place: Float) -> None:
        """Take the (3,) place and heading that a search found, before they are refined."""
        turn = math.radians(_FOUND_STD_DEG) ** 2
        self.state = np.concatenate([place, np.zeros(3)])
        self.covariance = np.diag([_FOUND_STD_M**2, _FOUND_STD_M**2, turn, *self._rates()])

    def set_place(self, state: Float, covariance: Float) -> None:
        """Take what the stems say."""
        self.state, self.covariance, self.source = state, covariance, "stems"

    def correct_height(self, offset_m: Float, variance: Float) -> None:
        """Correct the height by (K,) differences of known levels, with their variances."""
        if not len(offset_m):
            return
        middle = float(np.median(offset_m))
        near = np.abs(offset_m - middle) <= 3 * np.sqrt(variance)
        # The levels of one frame share a part of their error, which more stems do not average.
        information = (near / variance).sum() / math.sqrt(max(int(near.sum()), 1))
        if information > 0:
            mean = float((near * offset_m / variance).sum() / (near / variance).sum())
            gain = self.height_variance / (self.height_variance + 1 / information)
            self.height_m += gain * mean
            self.height_variance *= 1 - gain

    def rotation(self) -> Float:
        """(2, 2) rotation from the level frame to the map."""
        cos, sin = math.cos(self.state[2]), math.sin(self.state[2])
        return np.array([[cos, -sin], [sin, cos]])

    def place_jacobian(self, level_m: Float) -> Float:
        """(K, 2, 3) change of the map places of (K, 2) level points with place and heading."""
        return place_jacobian(level_m @ self.rotation().T)
