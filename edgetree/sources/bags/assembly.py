"""Make frames of paired ROS messages, with camera, gravity and pose."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

import calib
from basetree.counts import kind_of_line
from basetree.errors import InputError
from calib.clouds import PointCloud
from calib.files.fields import choices_of
from edgetree.frames.frame import Frame
from edgetree.frames.rig import BeamReading, DepthReading, Rig
from edgetree.sources.arrays import metres_from_array
from edgetree.sources.bags.camera_info import CameraInfos
from edgetree.sources.bags.depth_alignment import DepthAlignment, View
from edgetree.sources.bags.exact import FILLED_TOPIC, ExactValues
from edgetree.sources.bags.messages import PictureDecoder, frame_of, stamp_ns
from edgetree.sources.bags.pairing import Pair, Picture
from edgetree.sources.bags.point_clouds import CloudDecoder, projected
from edgetree.sources.bags.realsense_sdk import is_static
from edgetree.sources.bags.topic_words import is_rectified
from edgetree.sources.bags.topics import Streams
from edgetree.sources.bags.transforms import TransformTree
from edgetree.sources.gravity import GravityFilter

_log = logging.getLogger(__name__)

_NS_PER_S: Final = 1_000_000_000
UNREADABLE: Final = "unreadable images"
BEFORE_KEY_FRAME: Final = "video packets before a key frame"
_MAX_WAIT_NS: Final = 150_000_000  # for the IMU and transforms, which may come after the picture


class Assembly:
    """The state that frames are made of: cameras, transforms and the direction of gravity.

    Args:
        path: The recording.
        streams: Its topics.
        rig: Unit, kind and correction of the depth, and a camera in place of the recorded one.
        counts: Where missing poses and unusable pictures are counted.

    Attributes:
        first_error: Why the first picture that cannot be decoded cannot; empty if there is none.
    """

    def __init__(self, path: Path, streams: Streams, rig: Rig, counts: Counter[str]) -> None:
        self._path, self._streams, self._rig = path, streams, rig
        if streams.has_clouds:
            rig.check_for_clouds(f"point clouds of {streams.depth}")
        self._counts = counts
        self._said: set[str] = set()
        self._tree = TransformTree()
        self._gravity = GravityFilter()
        self._exact = ExactValues()
        self._imu_frame = ""
        self._fixed: str | None = None  # the frame of the poses, once it is known
        self.first_error = ""
        self._decoders: dict[str, PictureDecoder | CloudDecoder] = {
            role: (
                CloudDecoder(topic)
                if role == "depth" and streams.has_clouds
                else PictureDecoder(topic, role)
            )
            for role, topic in _roles(streams)
            if topic is not None
        }
        self._alignment = DepthAlignment(str(streams.depth), self._tree, counts, self._say)
        self._cameras = {
            topic: CameraInfos(is_rectified=is_rectified(image))
            for topic, image in (
                (streams.depth_camera, streams.depth),
                (streams.camera, streams.colour),
            )
            if topic is not None and image is not None
        }

    def add(self, topic: str, message: Any, log_ns: int = 0) -> None:
        """Take a message that is no picture; its time of recording is that of a stamp of 0."""
        if topic in self._cameras:
            infos = self._cameras[topic]
            with choices_of(f"recording {self._path}: topic {topic}"):
                infos.add(message)
            if infos.error is not None:
                self._say(f"topic {topic}: {infos.error}")
        elif topic in self._streams.transforms:
            self._tree.add(message, is_static=is_static(topic), log_ns=log_ns)
            if self._tree.unusable:
                self._counts["transforms that are no rotation"] = self._tree.unusable
        elif topic == self._streams.exact:
            self._add_exact(str(message.data))
        elif topic == self._streams.filled:
            self._add_filled(message)
        elif topic == self._streams.imu:
            turn, push = message.angular_velocity, message.linear_acceleration
            self._imu_frame = frame_of(message)
            self._gravity.add(
                (stamp_ns(message) or log_ns) / _NS_PER_S,
                np.array([push.x, push.y, push.z], np.float64),
                np.array([turn.x, turn.y, turn.z], np.float64),
            )
            if self._gravity.unusable:
                self._counts["IMU samples out of range"] = self._gravity.unusable

    def arrived(self, role: str, message: Any) -> None:
        """Take note of a picture in the order of recording, whether or not it will be used."""
        self._decoders[role].arrived(message)

    def is_alone(self, picture: Picture) -> bool:
        """Whether the recording says that a picture is the only one of its frame."""
        return self._exact.is_alone(picture.stamp)

    def _add_exact(self, text: str) -> None:
        try:
            self._exact.add(text)
        except InputError as error:
            self._counts["unreadable messages"] += 1
            self._say(str(error))

    def _add_filled(self, message: Any) -> None:
        try:
            filled = PictureDecoder(FILLED_TOPIC, "depth").decode(message)
        except InputError as error:
            self._counts["unreadable messages"] += 1
            self._say(str(error))
            return
        self._exact.add_filled(stamp_ns(message), filled)

    def is_ready(self, pair: Pair, log_ns: int) -> bool:
        """Whether IMU and transforms up to the picture are there, or were waited for."""
        if log_ns - pair.log_ns > _MAX_WAIT_NS:
            return True
        picture = pair.leading
        has_imu = self._streams.imu is None or self._gravity.newest_s >= picture.stamp / _NS_PER_S
        return has_imu and self._tree.is_complete(_frame(picture), picture.stamp)

    def frame(self, number: int, time_s: float, pair: Pair) -> Frame | None:
        """Decode a pair; None if a picture cannot be decoded.

        Raises:
            InputError: Floating-point depth is in millimetres.
        """
        try:
            image = self._decoded(pair.colour, "colour")
            depth = self._decoded(pair.depth, "depth")
            beams = self._beams(pair, image, depth)
        except InputError as error:
            self.first_error = self.first_error or str(error)
            self._say(str(error))
            return None
        picture = pair.leading
        if beams is not None:
            depth = None
        camera, reading, is_moved = self._measured(pair, image, depth)
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
        if is_moved:
            frame = replace(frame, depth_is_moved=True)
        if beams is not None:
            frame = replace(frame, depth_m=beams.depth_m, filled_depth_m=beams.filled_m)
        return self._exact.applied(frame, picture.stamp)

    def _measured(
        self, pair: Pair, image: NDArray[Any] | None, depth: NDArray[Any] | None
    ) -> tuple[calib.PinholeCamera | None, DepthReading | None, bool]:
        """The camera of the frame, its depth in the pixels of that, and whether it was moved."""
        colour, own = self._view(pair.colour, image), self._view(pair.depth, depth)
        leading = colour or own
        given = None if leading is None else self._given(leading)
        if colour is not None and own is not None and given is None and colour.camera is None:
            colour = leading = self._with_shared_camera(colour, own)
        camera = given or (None if leading is None else leading.camera)
        if leading is not None and camera is None:
            width, height = leading.size_px
            self._say(f"there is no camera for {width}x{height} px, so that nothing is measured")
        reading, is_moved = None, False
        if own is not None and depth is not None:
            name = f"depth of {self._streams.depth}"
            of_range = self._camera_of_range(own, colour, camera)
            reading = metres_from_array(depth, self._rig.depth_convention, name, of_range)
            if colour is not None and pair.depth is not None:
                is_moved = not self._alignment.is_aligned(own, colour)
                reading = self._alignment.aligned(reading, own, colour, pair.depth.stamp, given)
        return camera, reading, is_moved

    def _given(self, view: View) -> calib.PinholeCamera | None:
        """The camera of the rig for pictures of this size: it takes the place of a recorded one."""
        try:
            return self._rig.camera_for(*view.size_px)
        except calib.CameraError as error:
            raise calib.CameraError(f"recording {self._path}: {error}") from error

    def _beams(
        self, pair: Pair, image: NDArray[Any] | None, cloud: NDArray[Any] | PointCloud | None
    ) -> BeamReading | None:
        """The depth of a cloud in the picture; None without one, or if it cannot be projected."""
        if not isinstance(cloud, PointCloud) or pair.depth is None:
            return None
        view = self._view(pair.colour, image)
        camera = None if view is None else self._given(view) or view.camera
        source, topic = _frame(pair.depth), str(self._streams.depth)
        transform = self._rig.cloud_extrinsics
        if transform is None and view is not None:
            transform = self._tree.lookup(source, view.frame, pair.depth.stamp)
        if view is None or camera is None or transform is None:
            lacks = "the picture's camera" if camera is None else "a transform to it (--extrinsic)"
            raise InputError(f"clouds of {topic} in frame {source!r} lack {lacks}")
        return projected(cloud, camera, transform, topic)

    def _camera_of_range(
        self, own: View, colour: View | None, camera: calib.PinholeCamera | None
    ) -> calib.PinholeCamera | None:
        """The camera of a range image; None for depth along the optical axis.

        Where the range is alone or in the pixels of the colour, it is the camera of the frame.
        """
        if self._rig.depth_kind == "depth":
            return None
        if colour is None or self._alignment.is_aligned(own, colour):
            return camera
        return own.camera

    def _view(self, picture: Picture | None, values: NDArray[Any] | None) -> View | None:
        if picture is None or values is None:
            return None
        size_px = (values.shape[1], values.shape[0])
        role = "camera" if values.ndim == 3 else "depth_camera"
        return View(_frame(picture), size_px, self._camera(role, size_px))

    def _decoded(self, picture: Picture | None, role: Literal["colour", "depth"]) -> Any:
        """(H, W, 3) colour, (H, W) depth or a cloud."""
        if picture is None:
            return None
        decoder = self._decoders[role]
        try:
            values = decoder.decode(picture.message)
        except InputError:
            is_early = decoder.is_before_key_frame
            self._counts[BEFORE_KEY_FRAME if is_early else UNREADABLE] += 1
            raise
        if decoder.remark:
            self._say(decoder.remark)
        return values

    def _camera(self, role: str, size_px: tuple[int, int]) -> calib.PinholeCamera | None:
        topic = getattr(self._streams, role) or ""
        infos = self._cameras.get(topic)
        if infos is None:
            return None
        with choices_of(f"recording {self._path}: topic {topic}"):
            camera = infos.camera(*size_px)
        if infos.error is not None:
            self._say(f"topic {topic}: {infos.error}")
        if camera is not None and infos.size_from_pictures:
            self._say(
                f"topic {topic} states no size: it is taken to be that of the pictures,"
                f" {size_px[0]}x{size_px[1]} px"
            )
        is_own = role == "camera" or topic != self._streams.camera
        if camera is not None and infos.choice is not None and is_own:
            image = self._streams.colour if role == "camera" else self._streams.depth
            self._say(f"topic {image} is {infos.choice}")
        return camera

    def _with_shared_camera(self, colour: View, depth: View) -> View:
        """The view of the colour with the depth's camera, if that is the colour camera too."""
        if depth.camera is None or (colour.frame, colour.size_px) != (depth.frame, depth.size_px):
            return colour
        self._say(
            f"{self._streams.colour} has no camera: that of {self._streams.depth} is taken, in the"
            f" same frame {depth.frame!r}"
        )
        return replace(colour, camera=depth.camera)

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
        key = kind_of_line(line)
        if key not in self._said:
            self._said.add(key)
            _log.warning("recording %s: %s", self._path, line)


def _roles(streams: Streams) -> tuple[tuple[Literal["colour", "depth"], str | None], ...]:
    return ("colour", streams.colour), ("depth", streams.depth)


def _frame(picture: Picture | None) -> str:
    return "" if picture is None else frame_of(picture.message)
