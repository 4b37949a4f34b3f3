"""Frames as messages that `edgetree.sources` reads back without loss."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib import RigidTransform
from calib.depth.convention import in_metres
from edgetree.live.results import LiveResult
from edgetree.results.json_records import live_record
from edgetree.sinks.ros_types import RosTypes, time_ns
from edgetree.sources.bags.exact import EXACT_TOPIC, FILLED_TOPIC, FILLED_TYPE, exact_record

_CAMERA_FRAME: Final = "edgetree_camera"
_FIXED_FRAME: Final = "odom"
_MILLIMETRE_M: Final = 0.001
_GRAVITY_M_PER_S2: Final = 9.80665


class RecordedMessage(NamedTuple):
    """A message, its topic and its type."""

    topic: str
    kind: str
    message: Any


class RecordingMessages(RosTypes):
    """Makes the messages of recordings."""

    def of_result(self, result: LiveResult) -> Iterator[RecordedMessage]:
        """The frame that a result was made of, and the result.

        The images come last, as what is read before them belongs to them.
        """
        frame = result.frame
        time_s = frame.stamp_s
        header = self.header(time_s, _CAMERA_FRAME)
        camera, up_camera = frame.camera, frame.up_camera
        given = {"colour": frame.image, "depth": frame.depth_m}
        images = [name for name, each in given.items() if each is not None]
        more = (frame.depth_noise, frame.rotation_deg, images)
        exact = exact_record(time_ns(time_s), camera, up_camera, *more)
        yield self.text(EXACT_TOPIC, exact)
        if camera is not None:
            info = self.camera_info(header, camera)
            yield RecordedMessage("/edgetree/camera_info", "sensor_msgs/msg/CameraInfo", info)
        if up_camera is not None:
            imu = self._imu(time_s, up_camera)
            yield RecordedMessage("/edgetree/imu", "sensor_msgs/msg/Imu", imu)
        if frame.pose is not None:
            pose = self._pose(time_s, frame.pose)
            yield RecordedMessage("/tf", "tf2_msgs/msg/TFMessage", pose)
        if frame.filled_depth_m is not None:
            filled_m = frame.filled_depth_m.astype("<f4", copy=False)
            yield RecordedMessage(FILLED_TOPIC, FILLED_TYPE, self._image(header, "32FC1", filled_m))
        for topic, encoding, pixels in (
            ("/edgetree/depth", *_steps(frame.depth_m)),
            ("/edgetree/image", "bgr8", frame.image),
        ):
            if pixels is not None:
                message = self._image(header, encoding, pixels)
                yield RecordedMessage(topic, "sensor_msgs/msg/Image", message)
        yield self.text("/edgetree/json", live_record(result))

    def text(self, topic: str, record: dict[str, Any]) -> RecordedMessage:
        """A JSON object as a message."""
        message = self.new("std_msgs", "String", json.dumps(record))
        return RecordedMessage(topic, "std_msgs/msg/String", message)

    def _imu(self, time_s: float, up_camera: NDArray[np.float64]) -> Any:
        """An IMU at rest in the camera's frame; its orientation and turn rate are not known."""
        header = self.header(time_s, _CAMERA_FRAME)
        no_turn = self.new("geometry_msgs", "Quaternion", 0.0, 0.0, 0.0, 1.0)
        still = self.vector(np.zeros(3), "Vector3")
        push = self.vector(up_camera * _GRAVITY_M_PER_S2, "Vector3")
        unknown, known = np.array([-1.0] + [0.0] * 8), np.zeros(9)
        values = (header, no_turn, unknown, still, unknown, push, known)
        return self.new("sensor_msgs", "Imu", *values)

    def _pose(self, time_s: float, pose: RigidTransform) -> Any:
        header = self.header(time_s, _FIXED_FRAME)
        return self.new("tf2_msgs", "TFMessage", [self.transform(header, _CAMERA_FRAME, pose)])

    def _image(self, header: Any, encoding: str, pixels: NDArray[Any]) -> Any:
        rows = np.ascontiguousarray(pixels)
        height, width = rows.shape[:2]
        data = rows.view(np.uint8).reshape(-1)
        size = (height, width, encoding, 0, rows.strides[0])
        return self.new("sensor_msgs", "Image", header, *size, data)


def _steps(depth_m: NDArray[np.float32] | None) -> tuple[str, NDArray[Any] | None]:
    """Depth in millimetres if that is exact, or else in metres, with its encoding."""
    if depth_m is None or not depth_m.size:
        return "", None
    steps = np.rint(depth_m * np.float32(1000))
    if steps.max() <= np.iinfo(np.uint16).max:
        millimetres = steps.astype(np.uint16)
        if np.array_equal(in_metres(millimetres, _MILLIMETRE_M), depth_m):
            return "16UC1", millimetres
    return "32FC1", depth_m.astype("<f4", copy=False)
