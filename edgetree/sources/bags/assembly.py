"""Make frames of paired ROS messages, with camera, gravity and pose."""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

import calib
from basetree.errors import InputError
from edgetree.frames.frame import Frame
from edgetree.frames.rig import DepthReading, Rig
from edgetree.sources.arrays import metres_from_array
from edgetree.sources.bags.camera_info import CameraInfos
from edgetree.sources.bags.exact import ExactValues
from edgetree.sources.bags.messages import decode_picture, stamp_ns
from edgetree.sources.bags.pairing import Pair, Picture
from edgetree.sources.bags.topics import Streams
from edgetree.sources.bags.transforms import TransformTree, frame_name
from edgetree.sources.gravity import GravityFilter

_log = logging.getLogger(__name__)

_NS_PER_S: Final = 1_000_000_000
_MAX_WAIT_NS: Final = 150_000_000  # for the IMU and transforms, which may come after the picture


class Assembly:
    """The state that frames are made of: cameras, transforms and the direction of gravity.

    Args:
        path: The recording.
        streams: Its topics.
        rig: Unit, kind and correction of the depth, and the camera of a range that has none.
        counts: Where missing poses and unusable pictures are counted.
    """

    def __init__(self, path: Path, streams: Streams, rig: Rig, counts: Counter[str]) -> None:
        self._path, self._streams, self._rig = path, streams, rig
        self._counts = counts
        self._said: set[str] = set()
        self._tree = TransformTree()
        self._gravity = GravityFilter()
        self._exact = ExactValues()
        self._imu_frame = ""
        self._fixed: str | None = None  # the frame of the poses, once it is known
        self._cameras = {
            topic: CameraInfos(is_rectified=_is_rectified(image))
            for topic, image in (
                (streams.depth_camera, streams.depth),
                (streams.camera, streams.colour),
            )
            if topic is not None and image is not None
        }

    def add(self, topic: str, message: Any) -> None:
        """Take a message that is no picture."""
        if topic in self._cameras:
            infos = self._cameras[topic]
            infos.add(message)
            if infos.error is not None:
                self._say(f"topic {topic}: {infos.error}")
        elif topic in self._streams.transforms:
            self._tree.add(message, is_static=topic.endswith("static"))
            if self._tree.unusable:
                self._counts["transforms that are no rotation"] = self._tree.unusable
        elif topic == self._streams.exact:
            self._add_exact(str(message.data))
        elif topic == self._streams.imu:
            turn, push = message.angular_velocity, message.linear_acceleration
            self._imu_frame = frame_name(message.header.frame_id)
            self._gravity.add(
                stamp_ns(message) / _NS_PER_S,
                np.array([push.x, push.y, push.z], np.float64),
                np.array([turn.x, turn.y, turn.z], np.float64),
            )

    def _add_exact(self, text: str) -> None:
        try:
            self._exact.add(text)
        except InputError as error:
            self._counts["unreadable messages"] += 1
            self._say(str(error))

    def is_ready(self, pair: Pair, log_ns: int) -> bool:
        """Whether IMU and transforms up to the picture are there, or were waited for."""
        if log_ns - pair.log_ns > _MAX_WAIT_NS:
            return True
        picture = pair.leading
        has_imu = self._streams.imu is None or self._gravity.newest_s >= picture.stamp / _NS_PER_S
        frame = frame_name(picture.message.header.frame_id)
        return has_imu and self._tree.is_complete(frame, picture.stamp)

    def frame(self, number: int, time_s: float, pair: Pair) -> Frame | None:
        """Decode a pair; None if a picture cannot be decoded.

        Raises:
            InputError: Floating-point depth is in millimetres.
        """
        try:
            image = self._decoded(pair.colour, "colour")
            depth = self._decoded(pair.depth, "depth")
        except InputError as error:
            self._counts["unreadable images"] += 1
            self._say(str(error))
            return None
        picture = pair.leading
        height, width = (depth if image is None else image).shape[:2]  # type: ignore[union-attr]
        own = "camera" if pair.colour is not None else "depth_camera"
        camera = self._camera(own, width, height)
        reading = None
        if depth is not None:
            name = f"depth of {self._streams.depth}"
            own_camera = self._camera_of_range(depth, camera)
            reading = metres_from_array(depth, self._rig.depth_convention, name, own_camera)
            if pair.colour is not None and pair.depth is not None:
                camera = camera or self._shared_camera(pair, width, height)
                reading = self._aligned(reading, pair.colour, pair.depth, (width, height), camera)
        frame = Frame(
            f"{self._path.stem}_{number:06d}",
            self._path,
            image,
            None if reading is None else reading.depth_m,
            None if reading is None else reading.fault,
            time_s,
            number,
            camera,
            self._up(picture),
            self._pose(picture),
        )
        return self._exact.applied(frame, picture.stamp)

    def _decoded(
        self, picture: Picture | None, role: Literal["colour", "depth"]
    ) -> NDArray[Any] | None:
        if picture is None:
            return None
        topic = str(getattr(self._streams, role))
        values = decode_picture(picture.message, topic)
        is_colour = values.ndim == 3
        if is_colour != (role == "colour"):
            found = "colour" if is_colour else "depth"
            raise InputError(f"an image of topic {topic} is {found}: expected {role}")
        return values

    def _camera(self, role: str, width: int, height: int) -> calib.PinholeCamera | None:
        infos = self._cameras.get(getattr(self._streams, role) or "")
        camera = infos.camera(width, height) if infos is not None else None
        if camera is None:
            self._say(f"there is no camera for {width}x{height} px, so that nothing is measured")
        return camera

    def _camera_of_range(
        self, depth: NDArray[Any], camera: calib.PinholeCamera | None
    ) -> calib.PinholeCamera | None:
        """The camera of a range image: its own, or that of the colour, or that of the rig."""
        if self._rig.depth_kind == "depth":
            return None
        height, width = depth.shape[:2]
        infos = self._cameras.get(self._streams.depth_camera or "")
        own = None if infos is None else infos.camera(width, height)
        fits = camera is not None and (camera.width, camera.height) == (width, height)
        return own or (camera if fits else None) or self._rig.camera_for(width, height)

    def _shared_camera(self, pair: Pair, width: int, height: int) -> calib.PinholeCamera | None:
        """The depth's camera, if it is the colour camera too."""
        same = _frame(pair.colour) == _frame(pair.depth)
        return self._camera("depth_camera", width, height) if same else None

    def _aligned(
        self,
        reading: DepthReading,
        colour: Picture,
        depth: Picture,
        size_px: tuple[int, int],
        camera: calib.PinholeCamera | None,
    ) -> DepthReading:
        """The depth in the pixels of the colour image."""
        height, width = reading.depth_m.shape
        source, target = _frame(depth), _frame(colour)
        topic = str(self._streams.depth)
        is_named_so = "aligned" in topic or "registered" in topic
        if (width, height) == size_px and (source == target or is_named_so):
            return reading
        transform = (
            calib.RigidTransform.identity()
            if source == target
            else self._tree.lookup(source, target, depth.stamp)
        )
        depth_camera = self._camera("depth_camera", width, height)
        if transform is None or depth_camera is None or camera is None:
            lacking = "tf has no transform between them" if transform is None else "a camera lacks"
            fault = (
                f"depth of {topic} is {width}x{height} px in frame {source!r} and colour"
                f" {size_px[0]}x{size_px[1]} px in frame {target!r}, and {lacking}: expected"
                " aligned depth"
            )
            self._say(fault)
            self._counts["depth not aligned"] += 1
            return DepthReading(np.zeros(size_px[::-1], np.float32), fault)
        depth_m = calib.register_depth(reading.depth_m, depth_camera, camera, transform)
        return DepthReading(depth_m, reading.fault)

    def _up(self, picture: Picture) -> NDArray[np.float64] | None:
        up = self._gravity.up(picture.stamp / _NS_PER_S)
        if up is None:
            if self._streams.imu is not None:
                self._counts["without gravity"] += 1
            return None
        to_camera = self._tree.lookup(self._imu_frame, _frame(picture), picture.stamp)
        if to_camera is None:
            self._say(
                f"tf has no transform from the IMU's frame {self._imu_frame!r} to the camera's"
                f" {_frame(picture)!r}, so that gravity is not known"
            )
            self._counts["without gravity"] += 1
            return None
        return np.asarray(to_camera.rotate(up), np.float64)

    def _pose(self, picture: Picture) -> calib.RigidTransform | None:
        if not self._streams.transforms:
            return None
        self._fixed = self._fixed or self._tree.fixed_frame(_frame(picture))
        frame, fixed = _frame(picture), self._fixed
        pose = self._tree.lookup(frame, fixed, picture.stamp) if fixed else None
        if pose is None:
            self._counts["without pose"] += 1
            self._say(
                f"tf has no transform from frame {_frame(picture)!r} to odom, map or world at"
                f" {picture.stamp / _NS_PER_S:.3f} s: frames without it have no pose"
            )
        return pose

    def _say(self, line: str) -> None:
        """Log a warning once; lines that differ in numbers alone count as one."""
        key = "".join(character for character in line if not character.isdigit())
        if key not in self._said:
            self._said.add(key)
            _log.warning("recording %s: %s", self._path, line)


def _is_rectified(topic: str) -> bool:
    """Whether a topic is named as ROS names rectified images, such as image_rect_color."""
    return any("rect" in part.split("_") for part in topic.split("/"))


def _frame(picture: Picture | None) -> str:
    return "" if picture is None else frame_name(picture.message.header.frame_id)
