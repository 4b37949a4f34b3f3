"""Images and videos as live sources, through `edgetree.frames`."""

from __future__ import annotations

import logging
import math
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

import calib
from basetree.errors import InputError
from edgetree.frames import Rig, open_source
from edgetree.frames.pipeline import readable
from edgetree.frames.sources import Frame
from edgetree.live.frames import LiveFrame, LiveSource
from edgetree.live.sources.arrays import unit_vector

__all__ = ["open_files"]

_log = logging.getLogger(__name__)

_DEFAULT_RATE_HZ: Final = 15.0


def open_files(
    path: Path,
    depth: Path | None = None,
    *,
    depth_only: bool = False,
    rig: Rig | None = None,
    rate_hz: float = _DEFAULT_RATE_HZ,
) -> LiveSource:
    """Open an image, a folder of images or a video. Images that cannot be read are left out.

    Args:
        path: an image, a folder of images, or a video.
        depth: depth image or folder of depth images, as for `edgetree.frames.open_source`.
        depth_only: whether `path` contains depth images instead of colour images.
        rig: the cameras and the unit of the depth.
        rate_hz: frames per second of images, which have no time stamps.

    Raises:
        InputError: a file is missing or has another format, or the rate is not above 0.
    """
    if not (math.isfinite(rate_hz) and rate_hz > 0):
        raise InputError(f"rate_hz is {rate_hz}: expected frames per second, above 0")
    return _Files(path, depth, depth_only, rig or Rig(), rate_hz)


class _Files:
    """Frames of files."""

    is_live = False

    def __init__(
        self, path: Path, depth: Path | None, depth_only: bool, rig: Rig, rate_hz: float
    ) -> None:
        self.name = str(path)
        self._counts = Counter[str]()
        self.counts: dict[str, int] = self._counts
        self._rig, self._rate_hz = rig, rate_hz
        self._frames = open_source(path, depth, depth_only=depth_only, rig=rig)
        self._is_closed = threading.Event()

    def __iter__(self) -> Iterator[LiveFrame]:
        for number, frame in enumerate(readable(self._frames, self._leave_out)):
            if self._is_closed.is_set():
                return
            # The frames that were left out have numbers and times too.
            yield self._live(number + self._counts["unreadable images"], frame)

    def close(self) -> None:
        """End an iteration in progress."""
        self._is_closed.set()

    def _leave_out(self, error: Exception) -> None:
        self._counts["unreadable images"] += 1
        _log.warning("%s", error)

    def _live(self, number: int, frame: Frame) -> LiveFrame:
        picture = frame.depth_m if frame.image is None else frame.image
        camera = None
        if picture is not None:
            try:
                camera = self._rig.camera_for(picture.shape[1], picture.shape[0])
            except calib.CameraError as error:
                raise calib.CameraError(f"{frame.path}: {error}") from error
        up = None if self._rig.up_camera is None else unit_vector(np.array(self._rig.up_camera))
        return LiveFrame(
            number,
            number / self._rate_hz if frame.time_s is None else frame.time_s,
            frame.image,
            frame.depth_m,
            camera,
            up,
            None,
            frame.depth_fault,
        )
