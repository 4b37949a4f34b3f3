"""What tells sizes in pictures without depth: the camera's height, marks, a horizon."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import PinholeCamera, pixels_to_rays
from calib.boards.single_marker import SingleMarker
from calib.directions import unit
from edgetree.frames.frame import Frame
from edgetree.frames.turning import Turn

if TYPE_CHECKING:
    from edgetree.measure import CameraHeight, ScaleMark, Way

_log = logging.getLogger(__name__)

NO_FOCAL_LENGTH: Final = "the picture's EXIF states no focal length in its place"
"""Why a picture without a camera file has no camera."""

_LEAST_HORIZON_PX: Final = 1.0


@dataclass(frozen=True)
class ScaleBar:
    """Two points of a picture with a known distance between them.

    Attributes:
        ends_px: x and y of both, in px of the picture as it is stored.
        length_m: Their distance in metres.
    """

    ends_px: tuple[float, float, float, float]
    length_m: float


@dataclass(frozen=True)
class SizeReferences:
    """What tells sizes in pictures without depth.

    Attributes:
        camera_height: The camera's height above the ground.
        marker: A marker on or beside stems; every copy of it in a picture counts.
        scale_bar: A length on or beside a stem, for a single picture.
        horizon_px: x and y of two points on the horizon, in px of the picture as it is stored. It
            gives the vertical where none is given.

    Raises:
        InputError: The two points of the horizon are at one place.
    """

    camera_height: CameraHeight | None = None
    marker: SingleMarker | None = None
    scale_bar: ScaleBar | None = None
    horizon_px: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.horizon_px is None:
            return
        x0, y0, x1, y1 = self.horizon_px
        if not max(abs(x1 - x0), abs(y1 - y0)) >= _LEAST_HORIZON_PX:
            raise self._upright_horizon()

    def _upright_horizon(self) -> InputError:
        x0, y0, x1, y1 = self.horizon_px or (0.0, 0.0, 0.0, 0.0)
        return InputError(
            f"the horizon goes through ({x0:g}, {y0:g}) and ({x1:g}, {y1:g}): expected a point"
            " on its left and one on its right, as seen in the upright picture"
        )

    @property
    def give_distances(self) -> bool:
        """Whether they hold more than a horizon."""
        return any(each is not None for each in (self.camera_height, self.marker, self.scale_bar))

    def camera_for(self, frame: Frame, camera: PinholeCamera | None) -> PinholeCamera | None:
        """The camera of a frame: that given, or by EXIF, or for marks alone an assumed one.

        Args:
            frame: The frame.
            camera: What is known of its camera.
        """
        if camera is not None or frame.image is None:
            return camera
        from edgetree.measure.constants.placing import (
            ASSUMED_FOCAL_SHARE,
            ASSUMED_FOCAL_STD,
            EXIF_FOCAL_STD,
        )

        height, width = frame.image.shape[:2]
        if frame.exif_focal_px is not None:
            _tell_exif(round(frame.exif_focal_px), width, height, round(100 * EXIF_FOCAL_STD))
            return _camera(width, height, frame.exif_focal_px, EXIF_FOCAL_STD)
        if self.camera_height is not None:
            return None
        _tell_assumed_camera()
        focal_px = ASSUMED_FOCAL_SHARE * max(width, height)
        return _camera(width, height, focal_px, ASSUMED_FOCAL_STD)

    def up_camera(self, camera: PinholeCamera, turn: Turn) -> NDArray[np.float64] | None:
        """(3,) the vertical by the horizon, in the camera's frame; None without a horizon.

        Args:
            camera: The camera of the picture as it is stored.
            turn: The turn that makes the picture upright.

        Raises:
            InputError: The horizon goes up and down in the upright picture.
        """
        if self.horizon_px is None:
            return None
        rays = turn.directions(pixels_to_rays(camera, np.reshape(self.horizon_px, (2, 2))))
        if not abs(rays[1, 0] - rays[0, 0]) * camera.fx >= _LEAST_HORIZON_PX:
            raise self._upright_horizon()
        up = np.cross(rays[1], rays[0])
        return turn.back.directions(unit(-up if up[1] > 0 else up))

    def ways(self, frame: Frame, turn: Turn) -> list[Way]:
        """The ways to distances in a frame that is turned upright."""
        from edgetree.measure import ScaleMarks

        ways: list[Way] = [] if self.camera_height is None else [self.camera_height]
        marks, missing = self._marks(frame, turn)
        if missing:
            ways.insert(0, ScaleMarks(marks, missing))
        return ways

    def _marks(self, frame: Frame, turn: Turn) -> tuple[list[ScaleMark], str]:
        """The marks in a frame, and why a stem has none; empty if there is no kind of mark."""
        from edgetree.measure import ScaleMark

        marks, missing = [], ""
        if self.marker is not None and frame.image is not None:
            marker, picture = self.marker, turn.picture(frame.image)
            grey = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
            corners_px = marker.detect(grey)
            name = f"the marker of {100 * marker.side_m:g} cm"
            marks = [ScaleMark(corners, marker.side_m, name) for corners in corners_px]
            what = f"marker {marker.number} of {marker.dictionary}"
            missing = f"{what} is not seen in the picture: it may be too small, dark or covered"
            if marks:
                missing = f"{what} is not on or beside this stem"
        if self.scale_bar is not None and frame.image is not None:
            height, width = frame.image.shape[:2]
            ends_px = np.reshape(self.scale_bar.ends_px, (2, 2))
            if not ((ends_px >= 0) & (ends_px <= [width, height])).all():
                raise InputError(
                    f"--scale-bar has an end outside of {frame.where}, which is {width}x{height}"
                    " px: expected both in the picture"
                )
            ends_px = turn.points(ends_px, width, height)
            marks.append(ScaleMark(ends_px, self.scale_bar.length_m, "the scale bar"))
            missing = missing or "the scale bar is not on or beside this stem"
        return marks, missing


def _camera(width: int, height: int, focal_px: float, std: float) -> PinholeCamera:
    middle = ((width - 1) / 2, (height - 1) / 2)
    return PinholeCamera(width, height, focal_px, focal_px, *middle, focal_std_px=std * focal_px)


@lru_cache(maxsize=64)
def _tell_exif(focal_px: int, width: int, height: int, std: int) -> None:
    _log.warning(
        "no camera given: a focal length of %d px for %dx%d px, as the picture's EXIF states it"
        " (± %d %%); a calibrated --camera is more certain",
        *(focal_px, width, height, std),
    )


@lru_cache(maxsize=1)
def _tell_assumed_camera() -> None:
    _log.warning(
        "no camera given, and %s: distances are rough, diameters by a mark are hardly affected;"
        " pass --camera",
        NO_FOCAL_LENGTH,
    )
