"""The messages of ROS 2 that bags are made of, and that a node publishes."""

from __future__ import annotations

import math
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera, RigidTransform

_NS_PER_S: Final = 1_000_000_000
_ROS_SECONDS: Final = 2**31
_DISTORTION: Final = {"fisheye": "equidistant", "radtan": "plumb_bob"}


def time_ns(time_s: float) -> int:
    """A time stamp in whole ns, at least 1: ROS takes 0 as a stamp that is not set.

    ROS holds whole seconds from 0 to below 2**31. Stamps of clocks that count from 1900 or have
    negative times are brought there by multiples of 2**31 s (68 years).
    """
    whole_s = math.floor(time_s)
    stamp_ns = whole_s * _NS_PER_S + round((time_s - whole_s) * _NS_PER_S)
    return max(stamp_ns % (_ROS_SECONDS * _NS_PER_S), 1)


class MakeMessage(Protocol):
    """Makes a message of `package/msg/name` with the values of its fields, in their order."""

    def __call__(self, package: str, name: str, *values: Any) -> Any:
        """Make it."""


class RosTypes:
    """Makes messages.

    Args:
        make: Makes one message, such as of the classes of `rclpy`; if None, those of rosbags are
            made, which needs the extra `record`.

    Attributes:
        store: The types of rosbags; None if `make` is given.
    """

    def __init__(self, make: MakeMessage | None = None) -> None:
        self._make = make
        self.store: Any = None
        if make is None:
            from rosbags.typesys import Stores, get_typestore

            self.store = get_typestore(Stores.ROS2_HUMBLE)

    def new(self, package: str, name: str, *values: Any) -> Any:
        """A message of `package/msg/name` with the values of its fields, in their order."""
        if self._make is not None:
            return self._make(package, name, *values)
        return self.store.types[f"{package}/msg/{name}"](*values)

    def header(self, time_s: float, frame: str) -> Any:
        """The header of something at a time in a coordinate frame."""
        stamp = self.new("builtin_interfaces", "Time", *divmod(time_ns(time_s), _NS_PER_S))
        return self.new("std_msgs", "Header", stamp, frame)

    def vector(self, values: NDArray[np.floating[Any]], kind: str = "Point") -> Any:
        """(3,) numbers as a message of geometry_msgs, `Point` or `Vector3`."""
        return self.new("geometry_msgs", kind, *(float(value) for value in values))

    def quaternion(self, rotation: NDArray[np.floating[Any]]) -> Any:
        """A (3, 3) rotation matrix as a quaternion, exact to rounding for all angles.

        It is the eigenvector of the largest eigenvalue of a symmetric matrix (I. Y. Bar-Itzhack,
        New Method for Extracting the Quaternion from a Rotation Matrix, 2000).
        """
        r = np.asarray(rotation, np.float64)
        matrix = np.empty((4, 4))
        matrix[:3, :3] = r + r.T - np.trace(r) * np.eye(3)
        matrix[3, :3] = matrix[:3, 3] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
        matrix[3, 3] = np.trace(r)
        xyzw = np.linalg.eigh(matrix)[1][:, -1]
        return self.new("geometry_msgs", "Quaternion", *map(float, xyzw))

    def transform(self, header: Any, child: str, transform: RigidTransform) -> Any:
        """The place of the frame `child` in the header's frame, as a TransformStamped."""
        moved = self.vector(transform.translation_m, "Vector3")
        turned = self.quaternion(transform.rotation)
        values = self.new("geometry_msgs", "Transform", moved, turned)
        return self.new("geometry_msgs", "TransformStamped", header, child, values)

    def camera_info(self, header: Any, camera: PinholeCamera) -> Any:
        """A camera as CameraInfo."""
        terms = [float(term) for term in camera.distortion]
        model = _DISTORTION[camera.distortion_model]
        if model == "plumb_bob":
            model = "rational_polynomial" if len(terms) > 5 else model
            terms += [0.0] * (5 - len(terms))
        k = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1], np.float64)
        p = np.insert(k.reshape(3, 3), 3, 0.0, axis=1).reshape(-1)
        region = self.new("sensor_msgs", "RegionOfInterest", 0, 0, 0, 0, False)
        size, one = (camera.height, camera.width), np.eye(3).reshape(-1)
        values = (*size, model, np.array(terms), k, one, p, 0, 0, region)
        return self.new("sensor_msgs", "CameraInfo", header, *values)
