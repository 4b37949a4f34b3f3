"""Where a stem is cut, how high above the ground, and how it leans: one stem at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import CAMERA_UP, RigidTransform
from edgetree.measure.estimates import Estimate, Failure, PointEstimate
from edgetree.measure.ground import BaseGround
from edgetree.measure.settings import MeasureSettings

__all__ = ["CAMERA_UP_STD_DEG", "StemPlace"]

Float = NDArray[np.floating[Any]]

CAMERA_UP_STD_DEG = 15.0
"""How crookedly cameras are held or mounted, where nobody says: their own up stands in."""

# Where nothing tells the vertical the ground's normal stands in: forest ground slopes by so much.
_SLOPE_STD_RAD = math.radians(12.0)
# The cut lies a little below the diameter's section, and not in the ground.
_CUT_ABOVE_SECTION_M = (-0.5, 0.3)
_MOST_CUT_IN_GROUND_M = 0.1
_MOST_CUT_ABOVE_GROUND_M = 0.8
_FORWARD = np.array([0.0, 0.0, 1.0])
_STRAIGHT_DOWN = 0.999
# Stems nearer to the vertical than so many standard deviations lean nowhere.
_LEAST_LEAN = 1.5


@dataclass(frozen=True, eq=False)
class StemPlace:
    """One stem, and what is cut of it.

    Attributes:
        along: (3,) unit vector up the axis; `across` (3,) to its right and `facing` (3,) away
            from the camera.
        section: (3,) axis point of the diameter's section.
        cut: (3,) axis point of the felling cut.
        radius_m: of the section.
        distance_std_m: of the axis, along the line of sight.
        diameter_std_m: of the diameter.
        cut_rad: standard deviation of the cut's direction, up and down.
        shape_std_m: how far bark, swell and bends move the axis between section and cut.
        roll_std_rad: of the axis' angle as seen, `tilt_std_rad` towards or away from the camera.
    """

    along: Float
    across: Float
    facing: Float
    section: Float
    cut: Float
    radius_m: float
    distance_std_m: float
    diameter_std_m: float
    cut_rad: float
    shape_std_m: float
    roll_std_rad: float
    tilt_std_rad: float

    def distance(self) -> Estimate:
        """To the axis at the cut: what the depth gives is the bark, one radius before it."""
        value = math.hypot(*self.cut)
        parts = (self._depth_std_m(), self.diameter_std_m / 2, self._along_std_m())
        return Estimate(value, math.hypot(*parts, self.shape_std_m))

    def _depth_std_m(self) -> float:
        reach = float(self.cut @ self.facing)
        return self.distance_std_m * math.hypot(*self.cut) / max(reach, 1e-6)

    def _along_std_m(self) -> float:
        """How far the cut may slide along the axis, as it shows in the distance."""
        slant = math.hypot(*self.cut) / max(float(self.cut @ self.facing), 1e-6)
        return abs(float(self.cut @ self.along)) * slant * self.cut_rad

    def cut_height(self, ground: BaseGround | Failure) -> Estimate | Failure:
        """Above the ground; errs with the distance where looked at from above, and with the cut."""
        if isinstance(ground, Failure):
            return ground
        distance = self.distance()
        rise = float(self.cut @ ground.up) / distance.value
        std = math.hypot(rise * distance.std, self.cut_rad * distance.value)
        return ground.height_m(self.cut, self.along, self.radius_m, std)

    def misplaced(self, height: Estimate | Failure, has_section: bool) -> Failure | None:
        """Why the keypoint of the felling cut cannot be where the tree is cut, if so.

        `has_section` tells whether the section is the keypoints' own, which lies close by.
        """
        above_m = float((self.cut - self.section) @ self.along)
        lowest_m, highest_m = _CUT_ABOVE_SECTION_M
        if has_section and not lowest_m <= above_m <= highest_m:
            side = "above" if above_m > 0 else "below"
            return Failure(f"the felling cut is {abs(above_m):.2f} m {side} the diameter's section")
        if isinstance(height, Estimate) and height.value < -_MOST_CUT_IN_GROUND_M - 2 * height.std:
            return Failure(f"the felling cut is {-height.value:.2f} m below the ground")
        if (
            isinstance(height, Estimate)
            and height.value > _MOST_CUT_ABOVE_GROUND_M + 2 * height.std
        ):
            return Failure(
                f"the felling cut is {height.value:.2f} m above the ground: the depth may be of"
                " what stands before the stem"
            )
        return None

    def cut_point(self) -> PointEstimate:
        """On the bark that faces the camera."""
        point = self.cut - self.radius_m * self.facing
        return PointEstimate(point, np.sqrt(np.diag(self._covariance())))

    def cut_point_machine(self, mounting: RigidTransform | None) -> PointEstimate | Failure:
        """The same in the machine's frame."""
        if mounting is None:
            return Failure("no mounting of the camera given")
        turn = np.asarray(mounting.rotation, np.float64)
        covariance = turn @ self._covariance() @ turn.T
        point = mounting.apply(self.cut - self.radius_m * self.facing)
        return PointEstimate(np.asarray(point), np.sqrt(np.diag(covariance)))

    def _covariance(self) -> Float:
        """(3, 3) of the cut point, square metres."""
        reach = math.hypot(*self.cut)
        ahead_m = math.hypot(self._depth_std_m(), self.diameter_std_m / 4)
        sides = (
            (self.facing, ahead_m),
            (self.across, self.diameter_std_m / 4 + self.cut_rad * reach / 2),
            (self.along, self.cut_rad * reach),
        )
        scaled = np.array([std * side for side, std in sides])
        return np.asarray(scaled.T @ scaled)

    def lean(
        self, up: Float | None, ground: BaseGround | Failure, settings: MeasureSettings
    ) -> tuple[Estimate | Failure, Estimate | Failure]:
        """The axis against the vertical, and where it leans to as seen from above."""
        if up is None and isinstance(ground, Failure):
            missing = Failure(f"no vertical: {ground.reason}")
            return missing, missing
        vertical = up if isinstance(ground, Failure) else ground.up
        assert vertical is not None
        roll, tilt = float(vertical @ self.across), float(vertical @ self.facing)
        value = math.degrees(math.acos(min(max(float(vertical @ self.along), -1.0), 1.0)))
        total = roll**2 + tilt**2
        share = roll**2 / total if total > 0 else 0.5
        vertical_std = 0.0 if up is not None else _SLOPE_STD_RAD
        bend = math.radians(settings.bend_std_deg)
        roll_std = math.hypot(self.roll_std_rad, vertical_std, bend)
        tilt_std = math.hypot(self.tilt_std_rad, vertical_std, bend)
        std_deg = math.degrees(math.sqrt(share * roll_std**2 + (1 - share) * tilt_std**2))
        inclination = Estimate(value, std_deg)
        if value < _LEAST_LEAN * std_deg:
            return inclination, Failure(
                f"upright within its error: {value:.1f} ± {std_deg:.1f} deg"
            )
        sideways = math.sqrt((1 - share) * roll_std**2 + share * tilt_std**2)
        turn_std = math.degrees(sideways / math.radians(max(value, 1e-3)))
        return inclination, Estimate(self._lean_direction_deg(vertical), turn_std)

    def _lean_direction_deg(self, vertical: Float) -> float:
        """From where the camera looks on the level, clockwise as seen from above."""
        forward = _FORWARD if abs(vertical[2]) < _STRAIGHT_DOWN else np.array(CAMERA_UP)
        ahead = forward - (forward @ vertical) * vertical
        # As vertical x along lies to the left of where the stem leans, on the level.
        (ax, ay, az), (ux, uy, uz) = self.along.tolist(), vertical.tolist()
        sideways = np.array([uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax])
        return math.degrees(math.atan2(float(sideways @ ahead), float(self.along @ ahead)))
