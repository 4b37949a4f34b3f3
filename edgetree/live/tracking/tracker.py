"""Follow the stems of a recording over time, and fuse what all views say of each."""

from __future__ import annotations

import logging
import math

import numpy as np

from basetree.arrays import Bool, Float
from basetree.errors import InputError
from basetree.matching import match_greedily
from calib import RigidTransform, pixels_to_rays
from edgetree.detections import TreeDetections
from edgetree.frames.frame import Frame
from edgetree.live.tracking.ego_motion import EgoMotion
from edgetree.live.tracking.localisation import locate, match_costs
from edgetree.live.tracking.motion import CameraMotion
from edgetree.live.tracking.odometry import DepthOdometry
from edgetree.live.tracking.plane import wrapped
from edgetree.live.tracking.reports import report_tracks
from edgetree.live.tracking.settings import TrackingSettings
from edgetree.live.tracking.sightings import Sightings
from edgetree.live.tracking.stems import StemMap
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure import Failure, TreeMeasurement

_LOG = logging.getLogger(__name__)

# Added to the cost of a match with a detection of score 0, as a chi-square: of two detections of a
# stem, the one with the higher score is taken.
_DOUBT_COST = 10.0
# A contradicting view is at most this far from its stem, m; on the line of sight it may be further
# because the depth may be of something else, if it is to the side by at most the other distance.
_MAX_AWAY_M, _MAX_ASIDE_M, _MAX_ALONG_SIGHT_M = 1.0, 0.2, 2.0
# Trees without an axis are taken for a stem within half the width of their box, and at least this
# angle, that is not further away than this.
_MIN_HALF_WIDTH_RAD, _MAX_UNMEASURED_M = 0.03, 12.0
# A warning needs so many stems that lie on the ground, and at most this share of them that stand.
_MANY_LYING, _STANDING_SHARE = 8, 0.1


class StemTracker:
    """Follow stems in three dimensions, frame by frame.

    Stems are landmarks on the level plane. A frame's pose places the camera in the map. Without one
    the vertical gives its roll and pitch, the stems its place and heading, and registered depth
    images or else constant velocity bridge frames with too few stems. Where nothing tells how the
    camera moved, a new map begins, and its stems say so in their warnings.

    Args:
        settings: Assumptions about errors, motion and time; the defaults if None.
        odometry: Finds the motion between frames without poses from their depth images; None to do
            without.
    """

    def __init__(
        self,
        settings: TrackingSettings | None = None,
        odometry: DepthOdometry | None = None,
    ) -> None:
        self._settings = settings or TrackingSettings()
        self._stems = StemMap(self._settings)
        self._camera = EgoMotion(self._settings, odometry)
        self._motion = self._camera.motion
        self._time_s: float | None = None
        self._mapped = False
        self._remark = ""
        self._standing, self._lying, self._has_told = 0, 0, False

    @property
    def map_part(self) -> int:
        """Number of the map, from 1 on. Positions in different maps have nothing in common."""
        return self._stems.map_part

    @property
    def motion(self) -> CameraMotion:
        """Where the camera is in the map, how sure that is, and what it is from."""
        return self._motion

    @property
    def camera_pose(self) -> RigidTransform:
        """Transform from the camera's frame to the map."""
        return self._camera.camera_pose

    @property
    def up_camera(self) -> Float:
        """(3,) unit vector away from gravity in the camera's frame, by which stems are placed."""
        return self._camera.vertical.up

    def number_from(self, first: int) -> None:
        """Give new stems numbers from here on, at least, as lower ones are of other stems."""
        self._stems.number_from(first)

    def update(
        self, frame: Frame, trees: TreeDetections, measurements: list[TreeMeasurement]
    ) -> list[TreeTrack]:
        """Follow the stems into one more frame.

        Args:
            frame: The frame. Its time stamp, vertical and pose are used.
            trees: Its trees.
            measurements: One per tree, from `measure_trees` with the frame's vertical.

        Returns:
            All stems that are followed, seen in this frame or not.

        Raises:
            InputError: There is not one measurement per tree.
        """
        if len(measurements) != len(trees):
            raise InputError(
                f"there are {len(measurements)} measurements: expected {len(trees)}, one per tree"
            )
        step_s = self._step_s(frame.stamp_s)
        if frame.pose is not None and not self._camera.in_pose_frame and self._mapped:
            self._begin_map("the first pose came")
        self._camera.move(frame, measurements, step_s)
        doubt = self._border_doubt(trees)
        level, up_std_rad = self._camera.vertical.level, math.radians(self._camera.vertical.std_deg)
        seen = Sightings.from_measurements(measurements, level, up_std_rad, doubt)
        self._tell_lying(frame, measurements, len(seen))
        self._stems.begin_frame()
        if frame.pose is None:
            self._find_motion(seen, step_s)
        self._follow(seen.in_map(self._motion), trees, frame.stamp_s)
        self._name_unmeasured(frame, trees)
        self._stems.note_reasons(measurements)
        self._stems.forget(frame.stamp_s)
        return report_tracks(self._stems, self._motion, level, self._settings, self._remark)

    def _tell_lying(self, frame: Frame, measurements: list[TreeMeasurement], standing: int) -> None:
        """Warn once if nearly all stems lie on the ground: the vertical is then in wrong axes."""
        self._standing += standing
        self._lying += sum(not isinstance(each.axis, Failure) for each in measurements) - standing
        is_wrong = self._lying >= _MANY_LYING and self._standing < _STANDING_SHARE * self._lying
        if self._has_told or not is_wrong:
            return
        self._has_told = True
        axes = "the camera's axes (x right, y down, z forward)"
        given, wanted = "vertical", f"the direction away from gravity in {axes}"
        if frame.pose is not None:
            given, wanted = "poses", f"poses from {axes} to a frame with z up"
        _LOG.warning(
            "by the frames' %s, %d of %d stems lie on the ground and are not followed: expected %s",
            *(given, self._lying, self._lying + self._standing, wanted),
        )

    def _border_doubt(self, trees: TreeDetections) -> Float:
        """(N,) factors on the deviations of trees that the picture's border may cut off."""
        near_px = self._settings.border_share * trees.image_width
        cut_off = trees.boxes_px[:, 0] < near_px
        cut_off |= trees.boxes_px[:, 2] > trees.image_width - near_px
        return np.where(cut_off, self._settings.border_doubt, 1.0)

    def _step_s(self, time_s: float) -> float | None:
        """Time since the last frame; None for the first frame and after a jump back."""
        last_s, self._time_s = self._time_s, time_s
        if last_s is None:
            return None
        if time_s < last_s:
            _LOG.warning("the time jumped back from %.3f s to %.3f s", last_s, time_s)
            self._stems.rows["last_seen_s"] += time_s - last_s
            self._motion.forget_speed()
            return None
        return time_s - last_s

    def _begin_map(self, why: str) -> None:
        """Begin a new map at the camera's place."""
        self._remark = f"the map begins anew at {self._time_s:.2f} s: {why}"
        _LOG.warning("%s", self._remark)
        self._mapped = False
        self._stems.clear()
        self._camera.restart()

    def _find_motion(self, seen: Sightings, step_s: float | None) -> None:
        """Find the camera's place by the stems, or begin a new map where nothing tells it."""
        if not len(self._stems):
            if self._mapped and not self._camera.is_measured:
                self._begin_map("no stem is followed that tells how the camera moved")
            if not self._mapped:
                self._camera.restart()
            return
        lost = step_s is None or self._motion.place_std_m > self._settings.lost_std_m
        if len(seen) and not locate(self._motion, self._stems, seen, lost, self._settings.gate):
            self._begin_map("nothing tells how the camera moved")

    def _may_contradict(self, seen: Sightings, chi_square: Float) -> Bool:
        """(T, M) whether sightings that do not match may yet be of the stems."""
        to_stem, to_seen = self._stems.places_at(seen), seen.line[:, :2] - self._motion.state[:2]
        distance_m = np.hypot(*to_seen.T)
        away = to_stem - seen.line[:, :2]
        along_m = (away * to_seen).sum(-1) / distance_m
        aside_m = np.abs(away[..., 0] * to_seen[:, 1] - away[..., 1] * to_seen[:, 0]) / distance_m
        same = (chi_square <= self._settings.far_gate) & (np.hypot(along_m, aside_m) < _MAX_AWAY_M)
        behind = (aside_m < _MAX_ASIDE_M) & (np.abs(along_m) < _MAX_ALONG_SIGHT_M)
        behind &= np.isfinite(chi_square) & self._stems.confirmed[:, None]
        return np.asarray(same | behind)

    def _name_unmeasured(self, frame: Frame, trees: TreeDetections) -> None:
        """Find the stems of trees without an axis by the direction that they are seen in."""
        rows = self._stems.rows
        without = np.ones(len(trees), np.bool_)
        without[rows["tree"][rows["tree"] >= 0]] = False
        free = np.flatnonzero(without)
        hidden = np.flatnonzero((rows["tree"] < 0) & self._stems.confirmed)
        if frame.camera is None or not len(free) or not len(hidden):
            return
        boxes = trees.boxes_px[free].astype(np.float64)
        rays = pixels_to_rays(
            frame.camera,
            np.stack([boxes[:, [0, 2]], np.repeat(boxes[:, 1::2].mean(1)[:, None], 2, 1)], -1),
        )
        sides = rays @ self._camera.vertical.level.T
        bearing = np.unwrap(np.arctan2(sides[..., 1], sides[..., 0]), axis=1)
        middle, half = bearing.mean(1), np.abs(np.diff(bearing, axis=1)[:, 0]) / 2
        to_stem = (rows["line"][hidden, :2] - self._motion.state[:2]) @ self._motion.rotation()
        off = np.abs(wrapped(np.arctan2(to_stem[:, 1], to_stem[:, 0])[:, None] - middle))
        within = off < np.maximum(half, _MIN_HALF_WIDTH_RAD)
        within &= (np.hypot(*to_stem.T) < _MAX_UNMEASURED_M)[:, None]
        found, columns = match_greedily(off, within)
        self._stems.name(hidden[found], free[columns], frame.stamp_s)

    def _follow(self, seen: Sightings, trees: TreeDetections, time_s: float) -> None:
        """Match sightings in the map with the stems, fuse them, and begin new stems."""
        from_m, stems = self._motion.state[:2], self._stems
        free = np.ones(len(seen), np.bool_)
        if len(stems) and len(seen):
            cost, chi_square = match_costs(stems, seen)
            cost = cost + _DOUBT_COST * (1 - trees.scores[seen.tree])
            rows, columns = match_greedily(cost, chi_square <= self._settings.gate)
            stems.see(rows, seen.select(columns), from_m, time_s)
            free[columns] = False
            if free.any():
                chi_square[rows] = np.inf
                chi_square[:, columns] = np.inf
                self._follow_contradicting(seen, chi_square, free, time_s)
        stems.add(seen.select(np.flatnonzero(free)), from_m, time_s)
        stems.merge()
        self._mapped |= len(stems) > 0

    def _follow_contradicting(
        self, seen: Sightings, chi_square: Float, free: Bool, time_s: float
    ) -> None:
        """Find the stems of sightings that contradict them, and split those that do so for long.

        Args:
            seen: Sightings in the map.
            chi_square: (T, M) of their places; infinite for what is matched already.
            free: (M,) sightings that may begin new stems; changed in place.
            time_s: Time stamp.
        """
        stems = self._stems
        rows, columns = match_greedily(chi_square, self._may_contradict(seen, chi_square))
        stems.contradict(rows, seen.select(columns), time_s)
        split = stems.rows["in_a_row"][rows] >= self._settings.split_frames
        for row, column in zip(rows[split], columns[split], strict=True):
            one = seen.select(np.array([column]))
            stems.split(row, one, self._motion.state[:2], time_s)
        free[columns] = False
        free &= ~stems.overlap(seen)
