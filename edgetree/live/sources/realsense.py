"""RealSense cameras as live sources, with the package pyrealsense2.

Tested against a fake of pyrealsense2 that follows its documentation, never against a device.
"""

from __future__ import annotations

import importlib
import logging
import threading
import time
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from calib.files import realsense
from edgetree.errors import MissingDependency, install_hint
from edgetree.live.frames import LiveFrame, LiveSource, SourceLost
from edgetree.live.sources.arrays import frame_from_arrays, unit_vector
from edgetree.live.sources.gravity import GravityFilter

__all__ = ["open_realsense"]

_log = logging.getLogger(__name__)

_MS_PER_S: Final = 1000
_POLL_MS: Final = 200
_FRAME_TIMEOUT_S: Final = 5.0
# Width, height and rate of both streams, best first; USB 2 carries only the last one.
_MODES: Final = ((1280, 720, 30), (848, 480, 30), (640, 480, 30), (640, 480, 15))


def open_realsense(serial: str | None = None, *, up_camera: ArrayLike | None = None) -> LiveSource:
    """Open a RealSense camera: colour, depth aligned with it, intrinsics and gravity.

    Args:
        serial: serial number of the camera; None for any.
        up_camera: (3,) direction away from gravity in the camera's frame, for cameras without an
            IMU. An IMU's direction takes its place.

    Returns:
        The source. Its time stamps are those of the camera's driver.

    Raises:
        SourceLost: there is no such camera, or it has none of the known modes.
        MissingDependency: pyrealsense2 is not installed.
    """
    try:
        rs = importlib.import_module("pyrealsense2")
    except ImportError as error:
        raise MissingDependency(
            "pyrealsense2 is not installed, which RealSense cameras need:"
            f" {install_hint('realsense')}"
        ) from error
    return _RealSense(rs, serial, None if up_camera is None else unit_vector(up_camera))


class _RealSense:
    """A camera that streams until it is closed."""

    is_live = True

    def __init__(self, rs: Any, serial: str | None, up: NDArray[np.float64] | None) -> None:
        self.name = "realsense" if serial is None else f"realsense {serial}"
        self.counts: dict[str, int] = {"colour without depth": 0}
        self._rs, self._up = rs, up
        self._is_closed = threading.Event()
        self._gravity = GravityFilter()
        self._camera: calib.PinholeCamera | None = None
        self._has_intrinsics = False
        self._imu_to_camera: NDArray[np.float64] | None = None
        self._pipeline = rs.pipeline()
        try:
            profile = self._pipeline.start(self._config(serial))
        except RuntimeError as error:
            raise SourceLost(
                f"{self.name} cannot be opened ({error}): expected a camera that answers"
            ) from error
        self._scale_m = float(profile.get_device().first_depth_sensor().get_depth_scale())
        self._align = rs.align(rs.stream.color)

    def __iter__(self) -> Iterator[LiveFrame]:
        heard_s = time.monotonic()
        first = None
        while not self._is_closed.is_set():
            try:
                has_come, frames = self._pipeline.try_wait_for_frames(_POLL_MS)
            except RuntimeError as error:
                if self._is_closed.is_set():
                    return
                raise SourceLost(f"{self.name} stopped ({error})") from error
            if not has_come:
                if time.monotonic() - heard_s > _FRAME_TIMEOUT_S:
                    raise SourceLost(
                        f"{self.name} sent no frames for {_FRAME_TIMEOUT_S:g} s: expected it to be"
                        " there"
                    )
                continue
            heard_s = time.monotonic()
            self._take_motion(frames)
            aligned = self._align.process(frames)
            colour, depth = aligned.get_color_frame(), aligned.get_depth_frame()
            if not colour or not depth:
                self.counts["colour without depth"] += 1
                continue
            first = colour.get_frame_number() if first is None else first
            yield self._frame(colour.get_frame_number() - first, colour, depth)

    def close(self) -> None:
        """Stop the camera."""
        if not self._is_closed.is_set():
            self._is_closed.set()
            self._pipeline.stop()

    def _config(self, serial: str | None) -> Any:
        """The best mode that the camera has, with the IMU if there is one."""
        rs = self._rs
        for width, height, rate_hz in _MODES:
            for with_imu in (True, False):
                config = rs.config()
                if serial is not None:
                    config.enable_device(serial)
                config.enable_stream(rs.stream.color, width, height, rs.format.bgr8, rate_hz)
                config.enable_stream(rs.stream.depth, width, height, rs.format.z16, rate_hz)
                if with_imu:
                    config.enable_stream(rs.stream.accel)
                    config.enable_stream(rs.stream.gyro)
                if config.can_resolve(rs.pipeline_wrapper(self._pipeline)):
                    return config
        modes = ", ".join(f"{width}x{height} at {rate_hz} Hz" for width, height, rate_hz in _MODES)
        raise SourceLost(
            f"{self.name} is not there, or has no mode with colour and depth of {modes}"
        )

    def _take_motion(self, frames: Any) -> None:
        """Give the newest readings of the IMU to the filter."""
        streams = self._rs.stream
        accel, gyro = (frames.first_or_default(kind) for kind in (streams.accel, streams.gyro))
        if not accel:
            return
        if self._imu_to_camera is None:
            colour = frames.get_color_frame()
            if not colour:
                return
            turned = accel.get_profile().get_extrinsics_to(colour.get_profile()).rotation
            self._imu_to_camera = np.reshape(turned, (3, 3), order="F")  # column by column
        self._gravity.add(
            accel.get_timestamp() / _MS_PER_S, _vector(accel), _vector(gyro) if gyro else None
        )

    def _frame(self, number: int, colour: Any, depth: Any) -> LiveFrame:
        image = np.asanyarray(colour.get_data())
        if not self._has_intrinsics:
            self._camera, self._has_intrinsics = self._intrinsics(colour), True
        time_s = colour.get_timestamp() / _MS_PER_S
        level = self._gravity.up(time_s)
        up = self._up
        if level is not None and self._imu_to_camera is not None:
            up = self._imu_to_camera @ level
        return frame_from_arrays(
            number,
            time_s,
            image,
            np.asanyarray(depth.get_data()),
            depth_scale_m=self._scale_m,
            camera=self._camera,
            up_camera=up,
        )

    def _intrinsics(self, colour: Any) -> calib.PinholeCamera | None:
        found = colour.get_profile().as_video_stream_profile().get_intrinsics()
        names = ("width", "height", "fx", "fy", "ppx", "ppy")
        values = {name: getattr(found, name) for name in names}
        try:
            return realsense.build(
                values | {"coeffs": list(found.coeffs), "model": str(found.model)}
            )
        except calib.CameraError as error:
            _log.warning("%s: %s", self.name, error)
            return None


def _vector(frame: Any) -> NDArray[np.float64]:
    """(3,) the reading of an accelerometer or gyroscope."""
    data = frame.as_motion_frame().get_motion_data()
    return np.array([data.x, data.y, data.z], np.float64)
