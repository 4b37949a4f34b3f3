"""Recordings: ROS 1 bags, ROS 2 bags and MCAP files."""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from basetree.errors import InputError
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.sources.bags.assembly import Assembly
from edgetree.sources.bags.messages import stamp_ns
from edgetree.sources.bags.pairing import Pair, Pairing, Picture, StampCheck
from edgetree.sources.bags.reader import Bag, BrokenRecording, Message
from edgetree.sources.bags.realsense_sdk import is_static
from edgetree.sources.bags.topics import Modality, Streams, choose_streams
from edgetree.sources.playing import Looped, RisingClock
from edgetree.sources.source import BaseSource, FrameSource

_log = logging.getLogger(__name__)

_NS_PER_S: Final = 1_000_000_000
_DEFAULT_PERIOD_NS: Final = _NS_PER_S // 30
_SPARSE: Final = 1  # messages of a topic from which no rate follows


def open_recording(
    path: Path,
    *,
    topics: Mapping[str, str] | None = None,
    depth_scale_m: float | None = None,
    modality: Modality = "both",
    rig: Rig | None = None,
    loop: bool = False,
) -> FrameSource:
    """Open a ROS 1 bag, a ROS 2 bag or an MCAP file. Needs the extra `record`.

    MCAP files may hold messages of ROS 1, of ROS 2, and of Foxglove in protobuf or JSON.

    Colour and depth are paired by their header stamps within half a period. Frames have the camera
    of CameraInfo, the direction of gravity of an IMU, and the pose in odom, map or world of tf, as
    far as these are there. Depth of another frame or lens than the colour's is registered to it.

    Args:
        path: a file (.bag, .bag.active, .mcap, .db3, .mcap.zstd, .db3.zstd), or a folder of such
            files, which are one recording in the order of time.
        topics: Names of topics by role: "colour", "depth", "camera" and "depth_camera" (of type
            CameraInfo), and "imu". The others are found by type, encoding and frame.
        depth_scale_m: Metres per unit of the depth. By default that of `rig`, or what a recording
            of RealSense's SDK says, or 0.001 for 16UC1 and 1 for 32FC1.
        modality: "both" for all images there are, "rgb" for colour alone, "depth" for depth alone,
            which is then not registered to the colour.
        rig: Unit, kind and correction of the depth, and the camera, if it takes the place of the
            recorded one.
        loop: Whether to start again at the end, for ever. Numbers and time stamps go on rising.

    Returns:
        The source. What it leaves out is in its `counts`; warnings are logged.

    Raises:
        InputError: The recording cannot be read, has no such images, or it is not clear which
            topic is meant.
        MissingPackage: Rosbags is not installed.
    """
    rig = rig or Rig()
    rig = rig if depth_scale_m is None else replace(rig, depth_scale_m=depth_scale_m)
    recording = _Recording(path, topics or {}, rig, modality)
    return Looped(recording) if loop else recording


class _Recording(BaseSource):
    """A recording; every pass opens the file anew."""

    def __init__(
        self,
        path: Path,
        topics: Mapping[str, str],
        rig: Rig,
        modality: Modality,
    ) -> None:
        super().__init__(str(path))
        self._path, self._rig = path, rig
        self._first_error = ""
        with Bag(path) as bag:
            self._streams = choose_streams(bag, topics, modality)
            if self._rig.depth_scale_m is None:
                self._rig = replace(self._rig, depth_scale_m=bag.depth_unit_m)
            for name in bag.missing:
                self.counts["files missing"] += 1
                _log.warning("recording %s: its file %s is missing", path, name)
            for name in bag.empty:
                self.counts["files empty"] += 1
                _log.warning("recording %s: its file %s is empty", path, name)
            if bag.is_cut_off:
                self.counts["end missing"] += 1
                _log.warning("recording %s: its end is missing: what is there is read", path)
        self._log_choice()

    def __iter__(self) -> Iterator[Frame]:
        is_empty = True
        for frame in self._frames():
            is_empty = False
            yield frame
        if is_empty and not self._is_closed.is_set():
            raise InputError(self._nothing())

    def _frames(self) -> Iterator[Frame]:
        clock = RisingClock()
        number = 0
        self._first_error = ""
        try:
            with Bag(self._path) as bag:
                one_pass = _Pass(bag, self._streams, self._rig, self.counts)
                for pair in one_pass.pairs():
                    if self._is_closed.is_set():
                        return
                    time_s = clock.rising_s(pair.leading.stamp / _NS_PER_S)
                    frame = one_pass.assembly.frame(number, time_s, pair)
                    number += 1
                    self._first_error = one_pass.assembly.first_error
                    if frame is not None:
                        yield frame
        except BrokenRecording as error:
            if not number:
                raise
            self.counts["ended early"] += 1
            _log.warning("%s; the frames before were read", error)

    def _nothing(self) -> str:
        """Why not one frame came."""
        streams = self._streams
        if self._first_error:
            return (
                f"recording {self.name}: no picture could be decoded ({_told(self.counts)});"
                f" {self._first_error}"
            )
        if streams.colour and streams.depth:
            return (
                f"recording {self.name}: no image of {streams.colour} and {streams.depth} have time"
                f" stamps within half a period ({_told(self.counts)}): expected synchronised stamps"
            )
        return f"recording {self.name}: no image of {streams.colour or streams.depth} can be read"

    def _log_choice(self) -> None:
        streams = self._streams
        for role, topic in (
            ("colour", streams.colour),
            ("depth", streams.depth),
            ("camera", streams.camera or streams.depth_camera),
            ("IMU", streams.imu),
        ):
            _log.info("recording %s: %s is %s", self.name, role, topic or "not there")
        if streams.depth is not None and self._rig.depth_scale_m is None:
            _log.info(
                "recording %s: 16-bit depth is read as millimetres, 32-bit depth as metres, as the"
                " unit is not in the recording",
                self.name,
            )


class _Pass:
    """One pass through a recording.

    Args:
        bag: The open recording.
        streams: Its topics.
        rig: Unit, kind and correction of the depth, and a camera in place of the recorded one.
        counts: Where what is left out is counted.

    Attributes:
        assembly: Makes frames of the pairs.
    """

    def __init__(self, bag: Bag, streams: Streams, rig: Rig, counts: Counter[str]) -> None:
        self._bag, self._streams, self._counts = bag, streams, counts
        self.assembly = Assembly(bag.path, streams, rig, counts)
        self._roles = {streams.colour: "colour", streams.depth: "depth"}
        images = [name for name in (streams.colour, streams.depth) if name is not None]
        self._stamps = {role: StampCheck() for role in ("colour", "depth")}
        is_paired = len(images) == len(self._stamps)
        period_ns = _period_ns(bag, images)
        self._pairing = Pairing(self._stamps, period_ns, counts) if is_paired else None

    def pairs(self) -> Iterator[Pair]:
        """Yield the pairs, each at the time when its frame can be made."""
        self._read_what_stays()
        waiting: deque[Pair] = deque()
        for message in self._bag.messages(self._streams.names):
            content = self._bag.decode(message)
            if content is None:
                self._counts["unreadable messages"] += 1
                continue
            if message.topic.name in self._roles:
                waiting += self._pairs(message, content)
            else:
                self.assembly.add(message.topic.name, content, message.log_ns)
            while waiting and self.assembly.is_ready(waiting[0], message.log_ns):
                yield waiting.popleft()
        waiting += self._pairing.finish() if self._pairing else []
        yield from waiting

    def _read_what_stays(self) -> None:
        """Read the first cameras and the fixed transforms, which may come after images."""
        for name in (self._streams.camera, self._streams.depth_camera):
            content = self._bag.first(name) if name is not None else None
            if name is not None and content is not None:
                self.assembly.add(name, content)
        fixed = [name for name in self._streams.transforms if is_static(name)]
        for message in self._bag.messages(fixed) if fixed else ():
            content = self._bag.decode(message)
            if content is not None:
                self.assembly.add(message.topic.name, content)

    def _pairs(self, message: Message, content: object) -> list[Pair]:
        """The pairs that an image completes."""
        role = self._roles[message.topic.name]
        self.assembly.arrived(role, content)
        picture = Picture(stamp_ns(content) or message.log_ns, message.log_ns, content)
        state = self._stamps[role].see(picture.stamp)
        if state == "late":
            self._counts[f"{role} with a repeated or late stamp"] += 1
            return []
        leading = "colour" if self._streams.colour else "depth"
        if state == "jump" and role == leading:
            self._counts["clock jumped back"] += 1
        if self._pairing is not None and not self.assembly.is_alone(picture):
            return self._pairing.add(role, picture, is_jump=state == "jump")
        return [Pair(picture, None) if role == "colour" else Pair(None, picture)]


def _period_ns(bag: Bag, images: list[str]) -> int:
    """Mean period of the topic with the most messages."""
    most = max(bag.topics[name].count for name in images)
    return bag.duration_ns // (most - 1) if most > _SPARSE else _DEFAULT_PERIOD_NS


def _told(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {what}" for what, count in counts.items() if count)
