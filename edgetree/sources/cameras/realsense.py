"""RealSense cameras, with the package pyrealsense2.

Tested against a fake of pyrealsense2 that follows its documentation, never against a device.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from calib.files import realsense
from edgetree.frames.frame import Frame
from edgetree.sources.cameras.device import Device, load_sdk
from edgetree.sources.source import FrameSource

_MS_PER_S: Final = 1000
_POLL_MS: Final = 200
# Width, height and rate of both streams, best first; USB 2 carries only the last one.
_MODES: Final = ((1280, 720, 30), (848, 480, 30), (640, 480, 30), (640, 480, 15))


def open_realsense(serial: str | None = None, *, up_camera: ArrayLike | None = None) -> FrameSource:
    """Open a RealSense camera: colour, depth aligned with it, intrinsics and gravity.

    Args:
        serial: Serial number of the camera; None for any.
        up_camera: (3,) direction away from gravity in the camera's frame, for cameras without an
            IMU. An IMU's direction takes its place.

    Returns:
        The source. Its time stamps are those of the camera's driver.

    Raises:
        SourceLost: There is no such camera, or it has none of the known modes.
        MissingPackage: pyrealsense2 is not installed.
    """
    sdk = load_sdk("pyrealsense2", "pyrealsense2", "realsense", "RealSense")
    return _RealSense(sdk, serial, up_camera)


class _RealSense(Device):
    def __init__(self, rs: Any, serial: str | None, up_camera: ArrayLike | None) -> None:
        self._rs, self._serial = rs, serial
        self._pipeline = rs.pipeline()
        name = "realsense" if serial is None else f"realsense {serial}"
        super().__init__(name, up_camera, (RuntimeError,))

    def _start(self) -> None:
        profile = self._pipeline.start(self._config())
        self._scale_m = float(profile.get_device().first_depth_sensor().get_depth_scale())
        self._align = self._rs.align(self._rs.stream.color)

    def _stop(self) -> None:
        self._pipeline.stop()

    def _poll(self) -> Frame | None:
        has_come, frames = self._pipeline.try_wait_for_frames(_POLL_MS)
        if not has_come:
            return None
        self._take_motion(frames)
        aligned = self._align.process(frames)
        colour, depth = aligned.get_color_frame(), aligned.get_depth_frame()
        if not colour or not depth:
            self.counts["colour without depth"] += 1
            return None
        return self._frame(colour, depth)

    def _config(self) -> Any:
        """The best mode that the camera has, with the IMU if there is one."""
        rs = self._rs
        for width, height, rate_hz in _MODES:
            for with_imu in (True, False):
                config = rs.config()
                if self._serial is not None:
                    config.enable_device(self._serial)
                config.enable_stream(rs.stream.color, width, height, rs.format.bgr8, rate_hz)
                config.enable_stream(rs.stream.depth, width, height, rs.format.z16, rate_hz)
                if with_imu:
                    config.enable_stream(rs.stream.accel)
                    config.enable_stream(rs.stream.gyro)
                if config.can_resolve(rs.pipeline_wrapper(self._pipeline)):
                    return config
        modes = ", ".join(f"{width}x{height} at {rate_hz} Hz" for width, height, rate_hz in _MODES)
        raise RuntimeError(f"there is none with colour and depth of {modes}")

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

    def _frame(self, colour: Any, depth: Any) -> Frame:
        return self._frame_of(
            int(colour.get_frame_number()),
            colour.get_timestamp() / _MS_PER_S,
            np.asanyarray(colour.get_data()),
            np.asanyarray(depth.get_data()),
            self._scale_m,
            lambda: _intrinsics(colour),
        )


def _intrinsics(colour: Any) -> calib.PinholeCamera:
    found = colour.get_profile().as_video_stream_profile().get_intrinsics()
    names = ("width", "height", "fx", "fy", "ppx", "ppy")
    values = {name: getattr(found, name) for name in names}
    return realsense.build(values | {"coeffs": list(found.coeffs), "model": str(found.model)})


def _vector(frame: Any) -> NDArray[np.float64]:
    """(3,) the reading of an accelerometer or gyroscope."""
    data = frame.as_motion_frame().get_motion_data()
    return np.array([data.x, data.y, data.z], np.float64)
