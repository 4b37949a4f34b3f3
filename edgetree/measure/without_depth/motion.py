"""Distances of stems from the motion of the camera: several views of a stem, triangulated.

Each view of a stem gives a plane through the camera that holds the stem's axis. The axis is the
line (x + s z, y + t z, z) that fits all planes best, by weighted least squares; s and t are its
lean. The planes of views from one place are the same, so that the deviation of the distance falls
as the camera moves across the line of sight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from basetree.arrays import Float
from basetree.matching import match_greedily
from calib import RigidTransform
from edgetree.measure.constants.placing import (
    POSE_SCALE_STD,
    POSE_TURN_STD_DEG,
    USUAL_DIAMETER_M,
    USUAL_DIAMETER_STD,
    VIEW_STEP_M,
)
from edgetree.measure.constants.stems import MAX_RELATIVE_STD
from edgetree.measure.without_depth.placement import Placement, SeenStems

# A sighting may be of a stem within this many deviations, and this ratio of widths.
_GATE_STDS, _WIDTH_STD, _MAX_WIDTH_STDS = 3.0, 0.2, 3.0
# A stem that is not seen in so many frames is forgotten.
_FORGET_FRAMES = 10
_LEAST_VIEWS, _MOST_VIEWS = 3, 60
# A sighting is of a stem only if any other is worse by this much, as a chi-square: of two stems one
# behind the other, either may be seen.
_CLEAR_COST = 1.0
_ROUNDS = 3
# Height above and below the camera at which the planes are compared.
_REACH_M = 1.0
_NEAREST_M = 0.5


@dataclass(frozen=True, eq=False)
class _View:
    """One view of a stem, in the fixed frame of the poses.

    Attributes:
        from_m: (3,) the camera.
        normal: (3,) of the plane through the camera that holds the axis.
        ahead: (3,) unit vector towards the axis.
        std_rad: Standard deviation of the plane's direction.
        half_rad: Half the angle that the stem fills.
    """

    from_m: Float
    normal: Float
    ahead: Float
    std_rad: float
    half_rad: float

    @property
    def is_known(self) -> bool:
        """Whether both edges of the stem are seen."""
        known = np.isfinite(self.normal).all() and self.half_rad > 0
        return bool(known and math.isfinite(self.std_rad))

    def rows(self, level_m: float, distance_m: float) -> tuple[Float, Float]:
        """Two equations of the axis: (2, 4) factors and (2,) values, in standard deviations."""
        up_m = self.from_m[2] + np.array([-_REACH_M, _REACH_M]) - level_m
        x, y, z = self.normal.tolist()
        ones = np.ones(2)
        factors = np.stack([x * ones, y * ones, x * up_m, y * up_m], 1)
        values = float(self.normal @ self.from_m) - z * (up_m + level_m)
        # Both heights share the error of the direction.
        std_m = math.sqrt(2) * self.std_rad * max(distance_m, _NEAREST_M)
        return factors / std_m, values / std_m


@dataclass(frozen=True, eq=False)
class _Axis:
    """The axis of a stem: x and y at a level, and its lean, with their covariance (4, 4)."""

    state: Float
    covariance: Float
    level_m: float

    def distance_m(self, view: _View) -> float:
        """Distance of a view's camera from the axis, level with the camera."""
        return math.hypot(*(self.point_m(view.from_m[2]) - view.from_m)[:2].tolist())

    def point_m(self, height_m: float) -> Float:
        """(3,) its point at a height."""
        x, y = (self.state[:2] + (height_m - self.level_m) * self.state[2:]).tolist()
        return np.array([x, y, height_m])

    def std_m(self, direction: Float, height_m: float) -> float:
        """Standard deviation of its place at a height in a (3,) direction."""
        x, y, _ = direction.tolist()
        up_m = height_m - self.level_m
        factors = np.array([x, y, x * up_m, y * up_m])
        return math.sqrt(max(float(factors @ self.covariance @ factors), 0.0))


@dataclass(eq=False)
class _Track:
    """A stem that is followed: its views, the frame of the last of them, and its rough axis."""

    views: list[_View] = field(default_factory=list)
    last_frame: int = 0
    rough: _Axis | None = None

    def add(self, view: _View) -> None:
        """Add a view, or put it in the place of the last one if the camera has hardly moved."""
        if len(self.views) > 1:
            moved_m = float(np.linalg.norm(view.from_m - self.views[-2].from_m))
            if moved_m < VIEW_STEP_M:
                self.views.pop()
        self.views.append(view)
        del self.views[:-_MOST_VIEWS]


class StemViews:
    """Follows stems from frame to frame by the poses of the camera, and triangulates them.

    Call `at` with each frame of a source, and measure with the way that it returns.

    Args:
        lean_std_rad: Standard deviation of a stem's lean before it is seen.
    """

    def __init__(self, lean_std_rad: float = math.radians(6.0)) -> None:
        self._lean_std_rad = lean_std_rad
        self._tracks: list[_Track] = []
        self._seen: dict[int, tuple[_View, _Track | None, bool]] = {}
        self._frame = 0

    def at(self, pose: RigidTransform) -> MovingCamera:
        """The way to distances in the next frame, whose camera has this pose."""
        for view, track, is_doubtful in self._seen.values():
            if is_doubtful:
                continue
            if track is None:
                track = _Track()
                self._tracks.append(track)
            track.add(view)
            track.rough = self._fit(track.views, guessed=True)
            track.last_frame = self._frame
        self._seen = {}
        self._frame += 1
        first = self._frame - _FORGET_FRAMES
        self._tracks = [track for track in self._tracks if track.last_frame >= first]
        return MovingCamera(self, pose)

    def look(self, numbers: Sequence[int], views: Sequence[_View]) -> list[_Axis | None]:
        """Find the stems of some views, and fit their axes; None where too little is known.

        Args:
            numbers: Numbers of the trees in the frame.
            views: A view of each.
        """
        tracks = self._tracks
        found: list[_Track | None] = [None] * len(views)
        doubtful: set[int] = set()
        if tracks and views:
            cost = np.array([self._costs(track, views) for track in tracks])
            rows, columns = match_greedily(cost, np.isfinite(cost))
            for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
                others = np.concatenate(
                    [np.delete(cost[row], column), np.delete(cost[:, column], row)]
                )
                if (others > cost[row, column] + _CLEAR_COST).all():
                    found[column] = tracks[row]
                else:
                    doubtful.add(column)
                    tracks[row].last_frame = self._frame
        for index, number in enumerate(numbers):
            if views[index].is_known:
                self._seen[number] = (views[index], found[index], index in doubtful)
        return [
            None
            if track is None or len(track.views) + 1 < _LEAST_VIEWS
            else self._fit([*track.views, view], guessed=False)
            for view, track in zip(views, found, strict=True)
        ]

    def _costs(self, track: _Track, views: Sequence[_View]) -> list[float]:
        """How far each view is from that which a stem would give; infinite if it cannot be it."""
        axis, last = track.rough, track.views[-1]
        assert axis is not None
        width_m = axis.distance_m(last) * math.sin(last.half_rad)
        costs = []
        for view in views:
            height_m = float(view.from_m[2])
            to_stem = axis.point_m(height_m) - view.from_m
            distance_m = math.hypot(*to_stem[:2].tolist())
            std_m = math.hypot(axis.std_m(view.normal, height_m), distance_m * view.std_rad)
            aside = float(to_stem @ view.normal) / max(std_m, 1e-9)
            expected = width_m / max(distance_m, _NEAREST_M)
            wider = math.log(max(view.half_rad, 1e-6) / max(expected, 1e-6)) / _WIDTH_STD
            fits = abs(aside) < _GATE_STDS and abs(wider) < _MAX_WIDTH_STDS
            ahead = float(to_stem @ view.ahead) > 0
            costs.append(aside**2 + wider**2 if fits and ahead else math.inf)
        return costs

    def _fit(self, views: Sequence[_View], *, guessed: bool) -> _Axis:
        """The axis by some views; a guess of its distance helps to find it again."""
        last = views[-1]
        level_m = float(last.from_m[2])
        guess_m = USUAL_DIAMETER_M / 2 / max(math.sin(last.half_rad), 1e-6)
        prior = np.diag([0.0, 0.0, 1.0, 1.0]) / self._lean_std_rad**2 + 1e-9 * np.eye(4)
        start = last.from_m + guess_m * last.ahead
        axis = _Axis(np.array([start[0], start[1], 0.0, 0.0]), np.eye(4), level_m)
        towards = np.array([last.ahead[0], last.ahead[1], 0.0, 0.0])
        weight = 1 / (USUAL_DIAMETER_STD * guess_m) ** 2
        for _ in range(_ROUNDS):
            pairs = [view.rows(level_m, axis.distance_m(view)) for view in views]
            factors = np.concatenate([pair[0] for pair in pairs])
            values = np.concatenate([pair[1] for pair in pairs])
            information, vector = factors.T @ factors + prior, factors.T @ values
            if guessed:
                information = information + weight * np.outer(towards, towards)
                vector = vector + weight * float(towards[:2] @ start[:2]) * towards
            covariance = np.linalg.inv(information)
            axis = _Axis(covariance @ vector, covariance, level_m)
        # Views that disagree by more than their deviations widen the result (Birge's ratio). Both
        # equations of a view share one error, of which they have half the square each.
        freedom = max(len(views) - 2, 1)
        squares = float(((factors @ axis.state - values) ** 2).sum())
        return _Axis(axis.state, covariance * max(squares / freedom, 1.0), level_m)


@dataclass(frozen=True, eq=False)
class MovingCamera:
    """The way to distances in one frame of a camera whose poses are known.

    Attributes:
        views: Follows the stems.
        pose: Transform from the axes of the measured picture to a fixed frame (z up).
    """

    views: StemViews
    pose: RigidTransform

    def place(self, seen: SeenStems) -> Placement:
        """Place stems by their earlier views; see `SeenStems`."""
        rotation = np.asarray(self.pose.rotation)
        from_m = np.asarray(self.pose.translation_m, np.float64)
        frame, sections = seen.frame, seen.sections
        ahead = frame.to_camera(sections.view_direction) @ rotation.T
        along = frame.to_camera(sections.axes.along) @ rotation.T
        std_rad = np.hypot(seen.middle_std_rad, math.radians(POSE_TURN_STD_DEG))
        views = [
            _View(from_m, np.cross(up, to), to, std, half)
            for up, to, std, half in zip(
                along, ahead, std_rad.tolist(), sections.half_rad.tolist(), strict=True
            )
        ]
        axes = self.views.look(seen.numbers.tolist(), views)
        count = len(seen)
        distance_m, std = np.full(count, np.nan), np.full(count, np.inf)
        reasons: list[str | None] = [
            "the stem is not yet known by three views that are clearly of it"
        ]
        reasons *= count
        for index, (view, axis) in enumerate(zip(views, axes, strict=True)):
            if axis is None:
                continue
            value_m = float((axis.point_m(from_m[2]) - from_m) @ view.ahead)
            own = axis.std_m(view.ahead, float(from_m[2])) / max(value_m, 1e-6)
            if value_m <= 0 or own > MAX_RELATIVE_STD:
                reasons[index] = (
                    "the camera has not moved far enough across the line of sight to tell the"
                    " distance of the stem"
                )
                continue
            distance_m[index], reasons[index] = value_m, None
            std[index] = math.hypot(own, POSE_SCALE_STD)
        focal = frame.rig.focal
        told = (reasons, ["the camera's motion between several views"] * count, [""] * count)
        level_m = -distance_m * sections.height_ratio
        total = np.hypot(std, focal)
        return Placement(distance_m, total, total, level_m, seen.up, *told)
