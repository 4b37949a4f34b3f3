"""The camera's own motion: from poses, from depth images, or from its speed."""

from __future__ import annotations

import math

import numpy as np

from calib import RigidTransform
from calib.directions import level_rotation
from edgetree.frames.frame import Frame
from edgetree.live.tracking.motion import CameraMotion
from edgetree.live.tracking.odometry import CameraStep, DepthOdometry
from edgetree.live.tracking.settings import TrackingSettings
from edgetree.live.tracking.vertical import Vertical
from edgetree.measure import TreeMeasurement


class EgoMotion:
    """Moves the camera on from frame to frame, before its stems correct its place.

    Args:
        settings: Assumptions about the motion.
        odometry: Finds the motion from depth images in frames without a pose; None to go by the
            speed alone.

    Attributes:
        motion: Place, heading and speed in the map.
        vertical: The vertical of the latest frame.
        in_pose_frame: Whether the map is the frame of the poses.
        is_measured: Whether the latest motion was measured, and not predicted by the speed.
    """

    def __init__(self, settings: TrackingSettings, odometry: DepthOdometry | None) -> None:
        self.motion = CameraMotion(settings)
        self.vertical = Vertical(settings)
        self._odometry = odometry
        self.restart()

    def restart(self) -> None:
        """Make the camera's present place the origin of a map."""
        self.motion.restart()
        self.in_pose_frame = False
        self.is_measured = False

    @property
    def camera_pose(self) -> RigidTransform:
        """Transform from the camera's frame to the map."""
        turn = np.eye(3)
        turn[:2, :2] = self.motion.rotation()
        place = np.array([*self.motion.state[:2], self.motion.height_m])
        return RigidTransform(turn @ self.vertical.level, place)

    def move(self, frame: Frame, measurements: list[TreeMeasurement], step_s: float | None) -> None:
        """Move on to a frame.

        Args:
            frame: The frame.
            measurements: Its trees, for the vertical.
            step_s: Time since the last frame; None for the first one, and after a jump back.
        """
        before = self.vertical.level
        step = self._step(frame, step_s)
        self.vertical.take(frame, measurements, step)
        if frame.pose is not None:
            self._take_pose(frame.pose, step_s)
        elif step is not None:
            self.motion.advance(*step.in_level(before, self.vertical.level), step_s)
        else:
            self.motion.predict(math.inf if step_s is None else step_s)
        self.is_measured = frame.pose is not None or step is not None

    def _step(self, frame: Frame, step_s: float | None) -> CameraStep | None:
        """How the camera moved since the last frame, from the depth images; None if not known."""
        if self._odometry is None:
            return None
        if step_s is None or frame.pose is not None:
            self._odometry.restart()
        if frame.pose is not None:
            return None
        up = self.vertical.up if frame.up_camera is None else np.asarray(frame.up_camera)
        if not step_s:
            return self._odometry.step(frame, None)
        expected = self.motion.expected_step(step_s)
        now = level_rotation(up)
        guess = CameraStep.from_level(*expected, self.vertical.level, now, step_s)
        return self._odometry.step(frame, guess)

    def _take_pose(self, pose: RigidTransform, step_s: float | None) -> None:
        ahead = pose.rotation @ self.vertical.level[0]
        heading_rad = math.atan2(float(ahead[1]), float(ahead[0]))
        self.motion.set_pose(
            pose.translation_m, heading_rad, step_s if self.in_pose_frame else None
        )
        self.in_pose_frame = True
