"""Frames of messages that a node of ROS 2 receives, made as those of recordings are."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.sources.bags.assembly import Assembly
from edgetree.sources.bags.messages import stamp_ns
from edgetree.sources.bags.pairing import Pair, Picture
from edgetree.sources.bags.topics import Streams
from edgetree.sources.playing import RisingClock

_NS_PER_S: Final = 1_000_000_000
_FIELDS: Final = ("header", "height", "width", "encoding", "is_bigendian", "step", "format")
TRANSFORMS: Final = ("/tf", "/tf_static")


class TopicFrames:
    """Makes frames of messages of sensor_msgs and tf2_msgs, without the package rosbags.

    Frames have the camera of CameraInfo, the direction of gravity of an IMU and the pose in odom,
    map or world of tf, as far as these have come. Depth of another frame or lens than the colour's
    is registered to it, as `open_recording` does.

    Args:
        topics: Names of the topics by role: "colour", "depth", "camera", "depth_camera" and "imu".
            The names tell what is rectified and what is aligned. A role may be missing.
        rig: Unit, kind and correction of the depth, and a camera in place of that of CameraInfo.

    Attributes:
        counts: What was missing or could not be used, by reason.
    """

    def __init__(self, topics: dict[str, str], rig: Rig | None = None) -> None:
        self.counts: Counter[str] = Counter()
        self._streams = Streams(
            topics.get("colour"),
            topics.get("depth"),
            topics.get("camera"),
            topics.get("depth_camera"),
            topics.get("imu"),
            TRANSFORMS,
        )
        self._assembly = Assembly(Path("ros"), self._streams, rig or Rig(), self.counts)
        self._clock = RisingClock()
        self._number = 0

    def add(self, topic: str, message: Any) -> None:
        """Take a message that is no picture, by the name of its topic.

        Raises:
            InputError: It cannot be used.
        """
        self._assembly.add(topic, message)

    def frame(self, colour: Any | None, depth: Any | None) -> Frame | None:
        """The frame of a colour and a depth picture of the same moment, one of which may be None.

        Args:
            colour: A message Image or CompressedImage.
            depth: Likewise, of depth.

        Returns:
            The frame; None if a picture cannot be decoded, which is logged and counted.

        Raises:
            InputError: Floating-point depth is in millimetres.
        """
        pictures = {"colour": colour, "depth": depth}
        pair = Pair(*(_picture(message) for message in pictures.values()))
        for (role, _), picture in zip(pictures.items(), pair, strict=True):
            if picture is not None:
                self._assembly.arrived(role, picture.message)
        time_s = self._clock.rising_s(pair.leading.stamp / _NS_PER_S)
        frame = self._assembly.frame(self._number, time_s, pair)
        self._number += 1
        return frame


def _picture(message: Any | None) -> Picture | None:
    """A picture with its bytes as an array, which the classes of ROS hold in another type."""
    if message is None:
        return None
    fields = {name: getattr(message, name) for name in _FIELDS if hasattr(message, name)}
    stamp = stamp_ns(message)
    return Picture(
        stamp, stamp, SimpleNamespace(**fields, data=np.frombuffer(message.data, np.uint8))
    )
