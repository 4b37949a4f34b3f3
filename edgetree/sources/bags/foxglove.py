"""Foxglove's messages in the form of ROS messages.

Their fields are described at https://docs.foxglove.dev/docs/visualization/message-schemas. They
come in protobuf, in JSON, and as ROS messages of the package foxglove_msgs.
"""

from __future__ import annotations

import base64
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# The ROS type of each schema.
ROS_TYPES: Final = {
    "foxglove.CompressedImage": "sensor_msgs/msg/CompressedImage",
    "foxglove.CompressedVideo": "foxglove_msgs/msg/CompressedVideo",
    "foxglove.RawImage": "sensor_msgs/msg/Image",
    "foxglove.CameraCalibration": "sensor_msgs/msg/CameraInfo",
    "foxglove.FrameTransform": "tf2_msgs/msg/TFMessage",
    "foxglove.FrameTransforms": "tf2_msgs/msg/TFMessage",
}
# Seconds and nanoseconds in ROS 2, protobuf and JSON.
_TIME_NAMES: Final = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"))
_MOST_SECONDS: Final = 2**33
_STAMP: Final = "builtin_interfaces/Time timestamp\n"
_FRAME: Final = _STAMP + "string frame_id\n"
_SIZE: Final = _FRAME + "uint32 width\nuint32 height\n"
_LINK: Final = (
    _STAMP
    + "string parent_frame_id\nstring child_frame_id\ngeometry_msgs/Vector3 translation\n"
    + "geometry_msgs/Quaternion rotation\n"
)
# The messages of foxglove_msgs; `video_packets` has the one with video.
DEFINITIONS: Final = {
    "CompressedImage": _FRAME + "uint8[] data\nstring format\n",
    "RawImage": _SIZE + "string encoding\nuint32 step\nuint8[] data\n",
    "CameraCalibration": _SIZE
    + "string distortion_model\nfloat64[] D\nfloat64[9] K\nfloat64[9] R\nfloat64[12] P\n",
    "FrameTransform": _LINK,
    "FrameTransforms": "foxglove_msgs/FrameTransform[] transforms\n",
}


class Fields:
    """The fields of a JSON object as attributes."""

    def __init__(self, values: Any) -> None:
        if not isinstance(values, dict):
            raise ValueError("a message is no JSON object")
        self._values = values

    def __getattr__(self, name: str) -> Any:
        if name not in self._values:
            raise AttributeError(f"a message has no {name}")
        value = self._values[name]
        return Fields(value) if isinstance(value, dict) else value


def is_foxglove(message_type: str) -> bool:
    """Whether a type is one of Foxglove's that are read."""
    return schema_of(message_type) in ROS_TYPES


def schema_of(message_type: str) -> str:
    """The schema of a type: foxglove.RawImage for foxglove_msgs/msg/RawImage."""
    package, _, name = message_type.rpartition("/")
    return f"foxglove.{name}" if package.startswith("foxglove_msgs") else message_type


def as_ros(schema: str, message: Any) -> Any:
    """A message of a schema of Foxglove in the form of the ROS message with its content.

    Raises:
        KeyError, AttributeError, TypeError, ValueError: a field is missing or of another kind.
    """
    if schema == "foxglove.FrameTransforms":
        links = [Fields(x) if isinstance(x, dict) else x for x in message.transforms]
        return SimpleNamespace(transforms=[_link(link) for link in links])
    if schema == "foxglove.FrameTransform":
        return SimpleNamespace(transforms=[_link(message)])
    header = _header(message.timestamp, message.frame_id)
    if schema == "foxglove.CompressedVideo":  # which ROS has no type for
        return SimpleNamespace(
            timestamp=header.stamp,
            frame_id=header.frame_id,
            format=str(message.format),
            data=_bytes(message.data),
        )
    if schema == "foxglove.CameraCalibration":
        return _camera_info(message, header)
    common = {"header": header, "data": _bytes(message.data)}
    if schema == "foxglove.RawImage":
        return SimpleNamespace(
            width=int(message.width),
            height=int(message.height),
            encoding=str(message.encoding),
            step=int(message.step),
            is_bigendian=0,
            **common,
        )
    return SimpleNamespace(format=str(message.format), **common)


def _header(stamp: Any, frame: str) -> SimpleNamespace:
    return SimpleNamespace(stamp=_stamp(stamp), frame_id=str(frame))


def _stamp(stamp: Any) -> SimpleNamespace:
    """A time as ROS 2 has it; protobuf, JSON and ROS name its fields differently."""
    names = next(names for names in _TIME_NAMES if hasattr(stamp, names[1]))
    second, nanosecond = (int(getattr(stamp, name)) for name in names)
    if not (0 <= second < _MOST_SECONDS and 0 <= nanosecond < 10**9):
        raise ValueError(f"a time is {second} s and {nanosecond} ns")
    return SimpleNamespace(sec=second, nanosec=nanosecond)


def _bytes(data: Any) -> NDArray[np.uint8]:
    if isinstance(data, np.ndarray):
        return data
    content = base64.b64decode(data, validate=True) if isinstance(data, str) else bytes(data)
    return np.frombuffer(content, np.uint8)


def _camera_info(message: Any, header: SimpleNamespace) -> SimpleNamespace:
    region = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0, do_rectify=False)
    return SimpleNamespace(
        header=header,
        width=int(message.width),
        height=int(message.height),
        distortion_model=str(message.distortion_model),
        d=[float(value) for value in message.D],
        k=[float(value) for value in message.K],
        r=[float(value) for value in message.R],
        p=[float(value) for value in message.P],
        binning_x=0,
        binning_y=0,
        roi=region,
    )


def _link(link: Any) -> SimpleNamespace:
    return SimpleNamespace(
        header=_header(link.timestamp, link.parent_frame_id),
        child_frame_id=str(link.child_frame_id),
        transform=SimpleNamespace(
            translation=_numbers(link.translation, "xyz"), rotation=_numbers(link.rotation, "xyzw")
        ),
    )


def _numbers(values: Any, names: str) -> SimpleNamespace:
    return SimpleNamespace(**{name: float(getattr(values, name)) for name in names})
