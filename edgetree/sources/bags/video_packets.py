"""Pictures of H.264 and H.265 packets, decoded with the package PyAV."""

from __future__ import annotations

import re
from collections import deque
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.errors import MissingPackage, install_hint
from basetree.files.limits import current_limits
from edgetree.sources.bags.h264_numbers import FrameNumbers

FFMPEG_TYPE: Final = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
FOXGLOVE_TYPE: Final = "foxglove_msgs/msg/CompressedVideo"
# Their fields, for the reader: they are not among the types of the ROS distributions.
DEFINITIONS: Final = {
    FFMPEG_TYPE: (
        "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\n"
        "uint8 flags\nbool is_bigendian\nuint8[] data\n"
    ),
    FOXGLOVE_TYPE: (
        "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n"
    ),
}

_CODECS: Final = {
    "h264": "h264", "x264": "h264", "libx264": "h264", "avc": "h264", "avc1": "h264",
    "h265": "hevc", "x265": "hevc", "libx265": "hevc", "hevc": "hevc", "hvc1": "hevc",
}  # fmt: skip
_WORD: Final = re.compile(r"[a-z0-9]+")
_LARGEST_PX: Final = 8192 * 4352  # of the highest levels of both codes
_MOST_WAITING: Final = 256


def codec_of(form: str) -> str | None:
    """The code of a CompressedImage or of packets by its format; None if it is no video."""
    found = (_CODECS[word] for word in _WORD.findall(form.lower()) if word in _CODECS)
    return next(found, None)


class VideoDecoder:
    """Decodes the packets of one topic, each of which is a picture.

    A picture needs the ones before it, so all packets are added in their order, and decoded once
    one of them is asked for.

    Args:
        codec: "h264" or "hevc".

    Attributes:
        has_started: Whether a key frame has come.

    Raises:
        MissingPackage: PyAV is not installed.
    """

    def __init__(self, codec: str) -> None:
        try:
            import av
        except ImportError as error:
            raise MissingPackage(
                f"PyAV is not installed, which video of {codec} needs: {install_hint('video')}"
            ) from error
        self._av = av
        largest = min(current_limits().image_pixels, _LARGEST_PX)
        self._context: Any = av.CodecContext.create(codec, "r")
        self._context.options = {"max_pixels": str(largest), "flags": "low_delay"}
        self._context.thread_count = 1  # each thread would delay the pictures by one
        self._waiting: deque[Any] = deque()
        self._number = 0
        self._numbers = FrameNumbers() if codec == "h264" else None
        self._has_gap = False
        self.has_started = False

    def add(self, message: Any) -> None:
        """Take the next packet."""
        self._waiting.append(message)
        if len(self._waiting) > _MOST_WAITING:
            self._decode_one(self._waiting.popleft())

    def decode(self, message: Any) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 BGR, the picture of a packet that was added before.

        Raises:
            ValueError: It cannot be decoded, or needs packets that did not come.
        """
        if not any(message is packet for packet in self._waiting):
            raise ValueError("its packet waited too long for its partner")
        while True:
            packet = self._waiting.popleft()
            found = self._decode_one(packet)
            if packet is message:
                break
        if isinstance(found, str):
            raise ValueError(found)
        return np.asarray(found.to_ndarray(format="bgr24"), np.uint8)

    def _decode_one(self, message: Any) -> Any | str:
        """PyAV's frame of a packet, or why there is none."""
        data = message.data.tobytes()
        packet = self._av.Packet(data)
        packet.pts = packet.dts = self._number
        self._number += 1
        is_after_gap = self._numbers is not None and self._numbers.is_gap(data)
        try:
            frames = self._context.decode(packet) if data else []
        except (self._av.error.FFmpegError, ValueError, MemoryError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            return f"{reason}; expected a complete picture of {self._context.name}"
        is_key = any(frame.key_frame for frame in frames)
        self.has_started |= is_key
        self._has_gap = not is_key and (self._has_gap or is_after_gap)
        frame = next((frame for frame in frames if frame.pts == packet.pts), None)
        if frame is None and self._context.has_b_frames:
            return "pictures are not in the order of their packets, expected video without B frames"
        if not self.has_started:
            return "it is before the first key frame, or no picture"
        if frame is None:
            return "its packet holds no picture"
        if frame.is_corrupt or self._has_gap:
            return "packets before it are missing"
        return frame
