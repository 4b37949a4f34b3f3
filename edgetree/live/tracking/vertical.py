"""The vertical in the camera's frame, from what each frame tells of it."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float
from calib.directions import CAMERA_UP, level_rotation, unit
from edgetree.frames.frame import Frame
from edgetree.live.tracking.odometry import CameraStep
from edgetree.live.tracking.settings import TrackingSettings
from edgetree.measure import Failure, TreeMeasurement

# Share of the stems' axes in the vertical, where a step of the camera carries it on.
_STEMS_SHARE = 0.02


class Vertical:
    """The vertical of the latest frame: from its pose, its own, or the axes of its stems.

    Attributes:
        up: (3,) unit vector away from gravity in the camera's frame.
        level: (3, 3) rotation from the camera's frame to the level frame.
        known: Whether the latest frame told it, and not only its stems.
    """

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        self.up: Float = np.array(CAMERA_UP)
        self.level = level_rotation(self.up)
        self.known = False
        self._started = False

    @property
    def std_deg(self) -> float:
        """Standard deviation in degrees."""
        return self._settings.up_std_deg if self.known else self._settings.stem_up_std_deg

    def take(
        self, frame: Frame, measurements: list[TreeMeasurement], step: CameraStep | None
    ) -> None:
        """Take the vertical of a frame.

        Args:
            frame: The frame.
            measurements: Its trees, for their axes.
            step: How the camera moved since the last frame, if that is known.
        """
        self.known = True
        if frame.pose is not None:
            up = np.array(frame.pose.rotation[2])
        elif frame.up_camera is not None:
            up = np.asarray(frame.up_camera, np.float64)
        else:
            self.known = False
            up = self._from_stems(measurements, step)
        self.up = unit(up)
        self.level = level_rotation(self.up)

    def _from_stems(self, measurements: list[TreeMeasurement], step: CameraStep | None) -> Float:
        carried = self.up
        if step is not None:
            carried = np.asarray(self.up @ step.transform.rotation)
        axes = [m.axis.direction for m in measurements if not isinstance(m.axis, Failure)]
        if not axes:
            return carried
        middle = np.asarray(np.median(axes, axis=0))
        started, self._started = self._started, True
        if step is None or not started:
            return middle
        return np.asarray((1 - _STEMS_SHARE) * carried + _STEMS_SHARE * unit(middle))
