"""Point clouds from ROS messages (PointCloud2), and their depth in the pictures of a camera."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from basetree.errors import InputError
from calib import CloudError, PinholeCamera, RigidTransform
from calib.clouds import PointCloud
from calib.clouds.cloud import check_count, xyz_of_records
from edgetree.frames.rig import BeamReading

CLOUD_TYPE: Final = "sensor_msgs/msg/PointCloud2"
# The data types of sensor_msgs/PointField.
_KINDS: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_AXES: Final = ("x", "y", "z")


class CloudDecoder:
    """Decodes the clouds of one topic, in place of a `PictureDecoder` of depth.

    Args:
        topic: The topic's name, for messages.
    """

    is_before_key_frame = False
    remark = ""

    def __init__(self, topic: str) -> None:
        self._topic = topic

    def arrived(self, message: Any) -> None:
        """Take note of a cloud, of which nothing is needed before it is decoded."""

    def decode(self, message: Any) -> PointCloud:
        """Decode a cloud.

        Raises:
            InputError: The message cannot be decoded, or has no points.
        """
        try:
            return PointCloud(_points(message))
        except (CloudError, ValueError, TypeError) as error:
            raise InputError(
                f"a cloud of topic {self._topic} cannot be decoded: {error}"
            ) from error


def _points(message: Any) -> Any:
    """(N, 3) coordinates of a message, whose rows may be longer than their points."""
    order = ">" if message.is_bigendian else "<"
    fields = {str(field.name): field for field in message.fields}
    missing = [axis for axis in _AXES if axis not in fields]
    if missing:
        raise CloudError(f"its points have the fields {sorted(fields)}: expected x, y and z")
    kinds = [_KINDS.get(int(fields[axis].datatype), "") for axis in _AXES]
    offsets = [int(fields[axis].offset) for axis in _AXES]
    step, row_step = int(message.point_step), int(message.row_step)
    width, height = int(message.width), int(message.height)
    check_count(width * height)
    ends = [at + int(kind[1:] or 0) for at, kind in zip(offsets, kinds, strict=True)]
    data = np.asarray(message.data, np.uint8)
    if not all(kinds) or max(ends) > step or row_step < width * step or not width * height:
        raise CloudError(
            f"it states {width}x{height} points of {step} bytes, and rows of {row_step}"
        )
    if len(data) < height * row_step:
        raise CloudError(f"it has {len(data)} bytes: expected {height * row_step}")
    rows = data[: height * row_step].reshape(height, row_step)[:, : width * step]
    record = np.dtype(
        {
            "names": list(_AXES),
            "formats": [order + kind for kind in kinds],
            "offsets": offsets,
            "itemsize": step,
        }
    )
    return xyz_of_records(np.frombuffer(rows.tobytes(), record))


def projected(
    cloud: PointCloud, camera: PinholeCamera, to_camera: RigidTransform, topic: str
) -> BeamReading:
    """The depth of a cloud's beams in a picture.

    Args:
        cloud: The cloud.
        camera: The camera of the picture.
        to_camera: Transform from the cloud's frame to the camera's.
        topic: The cloud's topic, for messages.

    Raises:
        InputError: Hardly any point is in the picture.
    """
    try:
        return BeamReading.of_cloud(cloud, camera, to_camera)
    except CloudError as error:
        raise InputError(f"a cloud of topic {topic}: {error}") from error
