"""The stems of one frame, in a level frame below the camera's heading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from basetree.arrays import Float, Index
from edgetree.live.tracking.motion import CameraMotion
from edgetree.measure import Estimate, Failure, TreeMeasurement

QUANTITIES: Final = ("diameter_m", "dbh_m", "cut_height_m", "inclination_deg")
"""The scalar quantities that are fused; the height of the cut in the map follows them."""

DIAMETER, CUT_LEVEL = 0, 4

# An axis that leans more than this, as horizontal metres per metre of height, is not a stem's.
_MAX_SLOPE = 1.0
# Of the deviation of a value, so that something is left for what frames do not share.
_MOST_RIG_SHARE = 0.98


@dataclass(frozen=True, eq=False)
class Sightings:
    """Measured stems of a frame, M at once.

    The level frame has its origin at the camera, x forward, y left, z up.

    Attributes:
        tree: (M,) index of each among the trees of the frame.
        point_m: (M, 3) axis point.
        line: (M, 4) x and y of the axis at the height of the point, and its horizontal metres per
            metre of height.
        line_covariance: (M, 4, 4) covariance of its error.
        values: (M, 5) `QUANTITIES` and the height of the cut in the level frame; 0 where unknown.
        stds: (M, 5) their standard deviations without the errors of the rig; infinite where
            unknown.
        rig_stds: (M, 5) those of the rig's errors, which are the same in all frames.
    """

    tree: Index
    point_m: Float
    line: Float
    line_covariance: Float
    values: Float
    stds: Float
    rig_stds: Float

    def __len__(self) -> int:
        return len(self.tree)

    def select(self, rows: Index) -> Sightings:
        """Some of the sightings."""
        arrays = (self.point_m, self.line, self.line_covariance)
        scalars = (self.values, self.stds, self.rig_stds)
        return Sightings(self.tree[rows], *(array[rows] for array in (*arrays, *scalars)))

    def in_map(self, motion: CameraMotion) -> Sightings:
        """The same sightings in the map, with the error of the camera's place in their lines."""
        turn = motion.rotation()
        both = np.zeros((4, 4))
        both[:2, :2] = both[2:, 2:] = turn
        jacobian = motion.place_jacobian(self.point_m[:, :2])
        line = self.line @ both.T
        line[:, :2] += motion.state[:2]
        covariance = both @ self.line_covariance @ both.T
        covariance[:, :2, :2] += jacobian @ motion.covariance[:3, :3] @ jacobian.transpose(0, 2, 1)
        height_m = self.point_m[:, 2] + motion.height_m
        values, stds = self.values.copy(), self.stds.copy()
        values[:, CUT_LEVEL] += np.where(np.isfinite(stds[:, CUT_LEVEL]), motion.height_m, 0.0)
        stds[:, CUT_LEVEL] = np.hypot(stds[:, CUT_LEVEL], np.sqrt(motion.height_variance))
        point = np.column_stack([line[:, :2], height_m])
        return Sightings(self.tree, point, line, covariance, values, stds, self.rig_stds)

    def at_height(self, height_m: Float) -> Sightings:
        """The same sightings with their lines taken at other heights (M,)."""
        rise = height_m - self.point_m[:, 2]
        shift = np.zeros((len(self), 4, 4)) + np.eye(4)
        shift[:, 0, 2] = shift[:, 1, 3] = rise
        line = (shift @ self.line[..., None])[..., 0]
        covariance = shift @ self.line_covariance @ shift.transpose(0, 2, 1)
        scalars = (self.values, self.stds, self.rig_stds)
        return Sightings(self.tree, self.point_m, line, covariance, *scalars)

    @classmethod
    def from_measurements(
        cls,
        measurements: Sequence[TreeMeasurement],
        level: Float,
        up_std_rad: float,
        doubt: Float | None = None,
    ) -> Sightings:
        """Collect the measured stems of a frame.

        Args:
            measurements: One per tree of the frame.
            level: (3, 3) rotation from the camera's frame to the level frame.
            up_std_rad: Standard deviation of the vertical behind it.
            doubt: (N,) factors on the stated standard deviations of each tree; 1 by default.
        """
        measured = [
            (index, each.axis)
            for index, each in enumerate(measurements)
            if not isinstance(each.axis, Failure)
        ]
        if not measured:
            none = np.zeros((0, 5))
            return cls(
                np.zeros(0, np.intp), none[:, :3], none[:, :4], np.zeros((0, 4, 4)), *[none] * 3
            )
        # 1. Turn the axes and their covariances to the level frame.
        indices, axes = np.array([index for index, _ in measured]), [axis for _, axis in measured]
        point = np.array([axis.point_m for axis in axes]) @ level.T
        direction = np.array([axis.direction for axis in axes]) @ level.T
        point_covariance = level @ np.array([axis.point_covariance_m2 for axis in axes]) @ level.T
        turn_covariance = level @ np.array([axis.direction_covariance for axis in axes]) @ level.T
        # 2. Collect the scalar quantities; the height of the cut is that of the axis point.
        values, stds, rig_stds = _quantities([measurements[index] for index in indices])
        has_cut = np.array([bool(measurements[index].cut_point_m) for index in indices])
        values[has_cut, CUT_LEVEL] = point[has_cut, 2]
        stds[has_cut, CUT_LEVEL] = np.sqrt(point_covariance[has_cut, 2, 2])
        # 3. Enlarge the deviations by the doubt, and by the error of the vertical.
        if doubt is not None:
            factor = doubt[indices]
            stds *= factor[:, None]
            point_covariance = point_covariance * factor[:, None, None] ** 2
        reach = np.hypot(point[:, 0], point[:, 1])
        stds[:, CUT_LEVEL] = np.hypot(stds[:, CUT_LEVEL], up_std_rad * reach)
        # 4. Describe each axis as a line over the height, and leave out what is no stem's.
        sound = direction[:, 2] > 0
        upwards = np.where(sound, direction[:, 2], 1.0)[:, None]
        slope = direction[:, :2] / upwards
        sound &= np.hypot(slope[:, 0], slope[:, 1]) < _MAX_SLOPE
        sound &= np.isfinite(point).all(1) & np.isfinite(point_covariance).all((1, 2))
        place, turn = _projected(slope, point_covariance), _projected(slope, turn_covariance)
        covariance = _line_covariance(place, turn / upwards[:, None] ** 2, point, up_std_rad)
        line = np.concatenate([point[:, :2], slope], 1)
        every = (point, line, covariance, values, stds, rig_stds)
        return cls(indices[sound], *(array[sound] for array in every))


def _quantities(measurements: list[TreeMeasurement]) -> tuple[Float, Float, Float]:
    """(M, 5) values and deviations as in `Sightings`, without the heights of the cuts."""
    values = np.zeros((len(measurements), 5))
    stds, rig_stds = np.full(values.shape, np.inf), np.zeros(values.shape)
    for row, measurement in enumerate(measurements):
        for column, name in enumerate(QUANTITIES):
            result = getattr(measurement, name)
            if isinstance(result, Estimate) and result.std > 0:
                rig_std = min(measurement.rig_std.get(name, 0.0), _MOST_RIG_SHARE * result.std)
                values[row, column], rig_stds[row, column] = result.value, rig_std
                stds[row, column] = math.sqrt(result.std**2 - rig_std**2)
    return values, stds, rig_stds


def _projected(slope: Float, covariance: Float) -> Float:
    """(M, 2, 2) covariances on a level plane: a shift along the axis changes nothing there."""
    project = np.zeros((len(slope), 2, 3))
    project[:, 0, 0] = project[:, 1, 1] = 1.0
    project[:, :, 2] = -slope
    return np.asarray(project @ covariance @ project.transpose(0, 2, 1))


def _line_covariance(place: Float, turn: Float, point: Float, up_std_rad: float) -> Float:
    """(M, 4, 4) covariances of lines, from those of place and slope and the vertical's error."""
    unit = np.eye(2)
    covariance = np.zeros((len(point), 4, 4))
    covariance[:, :2, :2] = place
    covariance[:, :2, :2] += ((up_std_rad * point[:, 2]) ** 2)[:, None, None] * unit
    covariance[:, :2, :2] += 1e-6 * unit
    covariance[:, 2:, 2:] = turn + (up_std_rad**2 + 1e-6) * unit
    return covariance
