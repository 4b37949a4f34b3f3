"""OAK cameras as live sources, with the package depthai of version 3.

Tested against a fake of depthai that follows its documentation, never against a device.
"""

from __future__ import annotations

import importlib
import logging
import threading
import time
from collections.abc import Iterator
from datetime import timedelta
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from calib.files import fields
from edgetree.errors import MissingDependency, install_hint
from edgetree.live.frames import LiveFrame, LiveSource, SourceLost
from edgetree.live.sources.arrays import frame_from_arrays, unit_vector
from edgetree.live.sources.gravity import GravityFilter

__all__ = ["open_oak"]

_log = logging.getLogger(__name__)

_COLOUR_SIZE: Final = (1280, 720)
_STEREO_SIZE: Final = (640, 400)
_RATE_HZ: Final = 20
_IMU_RATE_HZ: Final = 100
_DEPTH_SCALE_M: Final = 0.001
_POLL_S: Final = 0.005
_FRAME_TIMEOUT_S: Final = 5.0


def open_oak(*, up_camera: ArrayLike | None = None) -> LiveSource:
    """Open an OAK camera with stereo depth: undistorted colour, aligned depth, gravity.

    Args:
        up_camera: (3,) direction away from gravity in the camera's frame, for cameras without an
            IMU that is calibrated. An IMU's direction takes its place.

    Returns:
        The source. Its time stamps are those of the exposure, s since 1970.

    Raises:
        SourceLost: there is no such camera, or it does not start.
        MissingDependency: depthai is not installed.
    """
    try:
        dai = importlib.import_module("depthai")
    except ImportError as error:
        raise MissingDependency(
            f"depthai is not installed, which OAK cameras need: {install_hint('oak')}"
        ) from error
    return _Oak(dai, None if up_camera is None else unit_vector(up_camera))


class _Oak:
    """A camera that streams until it is closed."""

    is_live = True
    name = "oak"

    def __init__(self, dai: Any, up: NDArray[np.float64] | None) -> None:
        self.counts: dict[str, int] = {}
        self._up = up
        self._is_closed = threading.Event()
        self._gravity = GravityFilter()
        self._imu_to_camera: NDArray[np.float64] | None = None
        self._camera: calib.PinholeCamera | None = None
        # The camera's stamps are in the clock of time.monotonic.
        self._start_s = time.time() - time.monotonic()
        try:
            self._pipeline = dai.Pipeline()
            self._pictures = _link_pictures(dai, self._pipeline)
            self._motion = self._link_imu(dai)
            self._pipeline.start()
        except RuntimeError as error:
            raise SourceLost(
                f"oak cannot be opened ({error}): expected a camera with stereo depth"
            ) from error

    def __iter__(self) -> Iterator[LiveFrame]:
        first = None
        heard_s = time.monotonic()
        while not self._is_closed.is_set():
            try:
                group = self._pictures.tryGet()
                self._take_motion()
            except RuntimeError as error:
                if self._is_closed.is_set():
                    return
                raise SourceLost(f"oak stopped ({error}): expected it to be there") from error
            if group is None:
                if time.monotonic() - heard_s > _FRAME_TIMEOUT_S:
                    raise SourceLost(
                        f"oak sent no frames for {_FRAME_TIMEOUT_S:g} s: expected it to be there"
                    )
                self._is_closed.wait(_POLL_S)
                continue
            heard_s = time.monotonic()
            colour, depth = group["colour"], group["depth"]
            first = colour.getSequenceNum() if first is None else first
            yield self._frame(colour.getSequenceNum() - first, colour, depth)

    def close(self) -> None:
        """Stop the camera."""
        if not self._is_closed.is_set():
            self._is_closed.set()
            self._pipeline.stop()

    def _link_imu(self, dai: Any) -> Any:
        """The queue of the IMU; None if there is none, or its axes are not calibrated."""
        device = self._pipeline.getDefaultDevice()
        if device.getConnectedIMU() in ("", "NONE"):
            return None
        try:
            matrix = device.readCalibration().getImuToCameraExtrinsics(dai.CameraBoardSocket.CAM_A)
        except RuntimeError as error:
            _log.warning("oak: the IMU is not used, as its axes are not known: %s", error)
            return None
        self._imu_to_camera = np.array(matrix, np.float64)[:3, :3]
        imu = self._pipeline.create(dai.node.IMU)
        sensors = [dai.IMUSensor.ACCELEROMETER_RAW, dai.IMUSensor.GYROSCOPE_RAW]
        imu.enableIMUSensor(sensors, _IMU_RATE_HZ)
        imu.setBatchReportThreshold(1)
        imu.setMaxBatchReports(10)
        return imu.out.createOutputQueue(maxSize=50, blocking=False)

    def _take_motion(self) -> None:
        for message in () if self._motion is None else self._motion.tryGetAll():
            for packet in message.packets:
                push, turn = packet.acceleroMeter, packet.gyroscope
                self._gravity.add(
                    self._time_s(push.getTimestamp()),
                    np.array([push.x, push.y, push.z], np.float64),
                    np.array([turn.x, turn.y, turn.z], np.float64),
                )

    def _frame(self, number: int, colour: Any, depth: Any) -> LiveFrame:
        image = colour.getCvFrame()
        if self._camera is None:
            self._camera = _intrinsics(colour, image.shape[1], image.shape[0])
        time_s = self._time_s(colour.getTimestamp())
        level = self._gravity.up(time_s)
        up = self._up
        if level is not None and self._imu_to_camera is not None:
            up = self._imu_to_camera @ level
        return frame_from_arrays(
            number,
            time_s,
            image,
            depth.getFrame(),
            depth_scale_m=_DEPTH_SCALE_M,
            camera=self._camera,
            up_camera=up,
        )

    def _time_s(self, stamp: timedelta) -> float:
        return self._start_s + stamp.total_seconds()


def _link_pictures(dai: Any, pipeline: Any) -> Any:
    """The queue of colour with the depth that is aligned to it; the newest pair alone."""
    sockets = dai.CameraBoardSocket
    colour = pipeline.create(dai.node.Camera).build(sockets.CAM_A)
    left = pipeline.create(dai.node.Camera).build(sockets.CAM_B)
    right = pipeline.create(dai.node.Camera).build(sockets.CAM_C)
    stereo = pipeline.create(dai.node.StereoDepth)
    sync = pipeline.create(dai.node.Sync)
    sync.setSyncThreshold(timedelta(seconds=0.5 / _RATE_HZ))
    image = colour.requestOutput(
        size=_COLOUR_SIZE, type=dai.ImgFrame.Type.BGR888i, fps=_RATE_HZ, enableUndistortion=True
    )
    left.requestOutput(size=_STEREO_SIZE, fps=_RATE_HZ).link(stereo.left)
    right.requestOutput(size=_STEREO_SIZE, fps=_RATE_HZ).link(stereo.right)
    stereo.setLeftRightCheck(True)
    stereo.setSubpixel(True)
    depth = stereo.depth
    if pipeline.getDefaultDevice().getPlatform() == dai.Platform.RVC4:
        align = pipeline.create(dai.node.ImageAlign)
        depth.link(align.input)
        image.link(align.inputAlignTo)
        depth = align.outputAligned
    else:
        image.link(stereo.inputAlignTo)
    image.link(sync.inputs["colour"])
    depth.link(sync.inputs["depth"])
    return sync.out.createOutputQueue(maxSize=1, blocking=False)


def _intrinsics(colour: Any, width: int, height: int) -> calib.PinholeCamera | None:
    """The camera of an undistorted picture, which knows how it was scaled and cropped."""
    transformation = colour.getTransformation()
    matrix = np.array(transformation.getIntrinsicMatrix(), np.float64)
    terms = [float(value) for value in transformation.getDistortionCoefficients()]
    focal_and_centre_px = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    try:
        return fields.camera((width, height), focal_and_centre_px, terms)
    except calib.CameraError as error:
        _log.warning("oak: its intrinsics are not used: %s", error)
        return None
