"""Recordings of RealSense's SDK and Viewer: ROS 1 bags without frames and with their own topics.

Their messages get a frame by their topic, such as device_0/sensor_0/Depth_0. The topic .../tf/0 of
a stream says how it lies to the stream that the SDK takes as reference, and the topic
.../option/Depth Units/value what the unit of the depth is in metres.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from calib import RigidTransform
from edgetree.sources.bags.decoding import TF_TYPE

_STREAM: Final = re.compile(r"/(device_\d+)/(sensor_\d+/[^/]+_\d+)/(?:image|info|imu)/.+")
_EXTRINSICS: Final = re.compile(r"/(device_\d+)/(sensor_\d+/[^/]+_\d+)/tf/(\d+)")
_DEPTH_UNIT: Final = re.compile(r"/device_\d+/sensor_\d+/option/Depth[ _]Units/value")
_DEPTH: Final = re.compile(r"/(device_\d+)/(sensor_\d+/Depth_\d+)/image/data")
_MOTION: Final = re.compile(r"/(?:Accel|Gyro|Motion)_\d+$")
_TRANSFORM_TYPE: Final = "geometry_msgs/msg/Transform"


def type_of(topic: str, message_type: str) -> str:
    """The type that messages are read as: transforms of streams are a tree as other transforms."""
    is_link = message_type == _TRANSFORM_TYPE and _EXTRINSICS.fullmatch(topic)
    return TF_TYPE if is_link else message_type


def is_static(topic: str) -> bool:
    """Whether the transforms of a topic hold for the whole recording."""
    return topic.endswith("static") or _EXTRINSICS.fullmatch(topic) is not None


def depth_unit_topic(topics: Iterable[str]) -> str | None:
    """The topic with the unit of the depth; None if there is none, or several."""
    found = [topic for topic in topics if _DEPTH_UNIT.fullmatch(topic)]
    return found[0] if len(found) == 1 else None


def depth_unit_m(message: Any) -> float | None:
    """Metres per step of the depth, by a message of that topic."""
    value = float(getattr(message, "data", math.nan))
    return round(value, 9) if math.isfinite(value) and value > 0 else None


def completed(topic: str, message: Any, topics: Collection[str]) -> Any:
    """A message with its frame, and the transform of a stream as a message of tf.

    Args:
        topic: The message's topic.
        message: The decoded message.
        topics: The names of all topics.
    """
    link = _EXTRINSICS.fullmatch(topic)
    if link is not None:
        return _tree_message(f"{link[1]}/{link[2]}", f"{link[1]}/extrinsics_{link[3]}", message)
    stream = _STREAM.fullmatch(topic)
    if stream is not None:
        message.header.frame_id = _frame(stream[1], stream[2], topics)
    return message


def _frame(device: str, stream: str, topics: Collection[str]) -> str:
    """The frame of a stream; of an IMU without a transform that of the depth, which lies alike."""
    has_link = any(topic.startswith(f"/{device}/{stream}/tf/") for topic in topics)
    depths = [found for topic in topics if (found := _DEPTH.fullmatch(topic)) is not None]
    if has_link or not _MOTION.search(stream) or len(depths) != 1:
        return f"{device}/{stream}"
    return f"{depths[0][1]}/{depths[0][2]}"


def _tree_message(stream: str, reference: str, message: Any) -> SimpleNamespace:
    """The SDK gives the transform from the reference to the stream; tf that to the parent."""
    moved, turned = message.translation, message.rotation
    quaternion = np.array([turned.x, turned.y, turned.z, turned.w], np.float64)
    there = RigidTransform.from_quaternion(
        quaternion / np.linalg.norm(quaternion), np.array([moved.x, moved.y, moved.z], np.float64)
    )
    place = there.inverse().translation_m
    entry = SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id=reference),
        child_frame_id=stream,
        transform=SimpleNamespace(
            translation=SimpleNamespace(x=place[0], y=place[1], z=place[2]),
            rotation=SimpleNamespace(x=-turned.x, y=-turned.y, z=-turned.z, w=turned.w),
        ),
    )
    return SimpleNamespace(transforms=[entry])
