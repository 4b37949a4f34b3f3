"""The direction away from gravity, from an IMU."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Sway and braking average out over some seconds; a gyroscope bridges them, but drifts over more.
_TIME_CONSTANT_S: Final = 1.0
_TIME_CONSTANT_WITH_GYRO_S: Final = 3.0
_MAX_STEP_S: Final = 0.5  # after a longer gap the filter starts anew
_KEPT_S: Final = 2.0
_MAX_AGE_S: Final = 0.5
# Beyond all accelerometers, whether they give m/s², g or mg, and all gyroscopes.
_LEAST_SIZE, _LARGEST_SIZE = 1e-3, 1e5
_LARGEST_TURN_RAD_PER_S: Final = 100.0


class GravityFilter:
    """Low-pass filter of the acceleration, turned along with the gyroscope where there is one.

    At rest, an accelerometer measures 9.81 m/s² upwards. Swaying and braking average out. The unit
    of the acceleration does not matter.

    Attributes:
        unusable: Number of samples that were left out, as no accelerometer or gyroscope has such
            values.
    """

    def __init__(self) -> None:
        self._level: NDArray[np.float64] | None = None
        self._samples = 0
        self.unusable = 0
        self._history: deque[tuple[float, NDArray[np.float64]]] = deque()

    @property
    def newest_s(self) -> float:
        """Time of the newest sample, s; minus infinity before the first."""
        return self._history[-1][0] if self._history else -math.inf

    def add(
        self,
        time_s: float,
        acceleration: NDArray[np.float64],
        turn_rad_per_s: NDArray[np.float64] | None = None,
    ) -> None:
        """Take a sample. Samples that are not finite or out of range are left out and counted.

        Args:
            time_s: Time of the sample, s.
            acceleration: (3,) measured acceleration in the IMU's frame.
            turn_rad_per_s: (3,) turn rates about the same axes; None or zeros without a gyroscope.
        """
        turn = (0.0, 0.0, 0.0) if turn_rad_per_s is None else turn_rad_per_s
        if not any(acceleration):  # a message of a gyroscope alone
            return
        is_usable = _LEAST_SIZE <= math.hypot(*acceleration) <= _LARGEST_SIZE
        if not (is_usable and math.hypot(*turn) <= _LARGEST_TURN_RAD_PER_S):
            self.unusable += 1
            return
        step_s = time_s - self.newest_s
        if self._level is None or not 0 <= step_s <= _MAX_STEP_S:
            self._history.clear()
            self._level, self._samples = np.array(acceleration, np.float64), 1
        else:
            constant_s = _TIME_CONSTANT_S
            if any(turn):
                constant_s = _TIME_CONSTANT_WITH_GYRO_S
                self._level = self._level - np.cross(turn, self._level) * step_s
            self._samples += 1
            share = max(step_s / (constant_s + step_s), 1 / self._samples)
            self._level = self._level + share * (acceleration - self._level)
        self._history.append((time_s, self._level))
        while self._history[0][0] < time_s - _KEPT_S:
            self._history.popleft()

    def up(self, time_s: float) -> NDArray[np.float64] | None:
        """(3,) unit vector away from gravity in the IMU's frame; None if not known at this time."""
        history = tuple(self._history)  # a copy, as samples may come from another thread
        if not history:
            return None
        stamp_s, level = min(history, key=lambda entry: abs(entry[0] - time_s))
        length = float(np.linalg.norm(level))
        if abs(stamp_s - time_s) > _MAX_AGE_S or not length > 0:
            return None
        return np.asarray(level / length)
