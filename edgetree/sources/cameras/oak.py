"""OAK cameras, with the package depthai of version 3.

Tested against a fake of depthai that follows its documentation, never against a device.
"""

from __future__ import annotations

import logging
import time
from datetime import timedelta
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

import calib
from calib.files import fields
from edgetree.frames.frame import Frame
from edgetree.sources.cameras.device import Device, load_sdk
from edgetree.sources.source import FrameSource

_log = logging.getLogger(__name__)

_COLOUR_SIZE: Final = (1280, 720)
_STEREO_SIZE: Final = (640, 400)
_RATE_HZ: Final = 20
_IMU_RATE_HZ: Final = 100
_DEPTH_SCALE_M: Final = 0.001
_POLL_S: Final = 0.005


def open_oak(*, up_camera: ArrayLike | None = None) -> FrameSource:
    """Open an OAK camera with stereo depth: undistorted colour, aligned depth, gravity.

    Args:
        up_camera: (3,) direction away from gravity in the camera's frame, for cameras without an
            IMU that is calibrated. An IMU's direction takes its place.

    Returns:
        The source. Its time stamps are those of the exposure, s since 1970.

    Raises:
        SourceLost: There is no such camera, or it does not start.
        MissingPackage: Depthai is not installed.
    """
    return _Oak(load_sdk("depthai", "depthai", "oak", "OAK"), up_camera)


class _Oak(Device):
    def __init__(self, dai: Any, up_camera: ArrayLike | None) -> None:
        self._dai = dai
        # The camera's stamps are in the clock of time.monotonic.
        self._start_s = time.time() - time.monotonic()
        super().__init__("oak", up_camera, (RuntimeError,))

    def _start(self) -> None:
        self._pipeline = self._dai.Pipeline()
        self._pictures = _link_pictures(self._dai, self._pipeline)
        self._motion = self._link_imu()
        self._pipeline.start()

    def _stop(self) -> None:
        self._pipeline.stop()

    def _poll(self) -> Frame | None:
        self._take_motion()
        group = self._pictures.tryGet()
        if group is None:
            self._is_closed.wait(_POLL_S)
            return None
        return self._frame(group["colour"], group["depth"])

    def _link_imu(self) -> Any:
        """The queue of the IMU; None if there is none, or its axes are not calibrated."""
        dai, device = self._dai, self._pipeline.getDefaultDevice()
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

    def _frame(self, colour: Any, depth: Any) -> Frame:
        image = colour.getCvFrame()
        return self._frame_of(
            int(colour.getSequenceNum()),
            self._time_s(colour.getTimestamp()),
            image,
            depth.getFrame(),
            _DEPTH_SCALE_M,
            lambda: _intrinsics(colour, image.shape[1], image.shape[0]),
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


def _intrinsics(colour: Any, width: int, height: int) -> calib.PinholeCamera:
    """The camera of an undistorted picture, which knows how it was scaled and cropped."""
    transformation = colour.getTransformation()
    matrix = np.array(transformation.getIntrinsicMatrix(), np.float64)
    terms = [float(value) for value in transformation.getDistortionCoefficients()]
    focal_and_centre_px = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    return fields.camera((width, height), focal_and_centre_px, terms)
