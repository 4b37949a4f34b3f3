"""Videos as sources of frames."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from basetree.errors import InputError
from basetree.files.limits import current_limits
from basetree.files.names import IMAGE_SUFFIXES, VIDEO_SUFFIXES
from basetree.files.reading import is_image_file, open_video
from edgetree.frames.frame import Frame
from edgetree.sources.source import BaseSource
from edgetree.sources.video_files import (
    incomplete_words,
    is_damaged,
    is_list_of_others,
    is_mp4,
    is_video_file,
)

_log = logging.getLogger(__name__)

_MOST_FAILURES: Final = 100  # in a row, after which a video has ended
_PICTURE_STREAMS: Final = (".mjpg", ".mjpeg")  # begin as a picture does
_RATES_HZ: Final = (1.0, 1000.0)
_DEFAULT_RATE_HZ: Final = 25.0


def is_video(path: Path) -> bool:
    """Whether a file is a video by its name or its content, and no picture."""
    if not path.is_file() or path.suffix.lower() in IMAGE_SUFFIXES or is_list_of_others(path):
        return False
    if path.suffix.lower() in VIDEO_SUFFIXES:
        return True
    return is_video_file(path) and not is_image_file(path)


def is_video_name(path: Path) -> bool:
    """Whether a path to write is the name of a video, and no folder that is there."""
    return path.suffix.lower() in VIDEO_SUFFIXES and not path.is_dir()


def is_picture(path: Path) -> bool:
    """Whether a file is a picture by its name or its content."""
    suffix = path.suffix.lower()
    if suffix in IMAGE_SUFFIXES:
        return True
    return suffix not in _PICTURE_STREAMS and is_image_file(path)


class VideoFrames(BaseSource):
    """The frames of a video.

    A video that ends before what it states, or whose frames cannot all be decoded, gives those
    that can be read; `counts` and a warning tell of the others.

    Args:
        path: The video.
        upright: Whether the frames are turned as the file says; otherwise they are as stored.

    Attributes:
        rate_hz: Frames per second that it states, or 25.
    """

    def __init__(self, path: Path, upright: bool = True) -> None:
        super().__init__(str(path))
        self._path, self._upright = path, upright
        with closing(_Capture(path, upright)) as capture:
            turn_deg = round(capture.video.get(cv2.CAP_PROP_ORIENTATION_META))
            if turn_deg:
                _log.warning("%s: %s", path, _turn_words(turn_deg, upright))
            stated = capture.video.get(cv2.CAP_PROP_FRAME_COUNT)
            if not capture.has_frame():
                raise InputError(
                    f"video {path} has no frame that OpenCV can read"
                    f"{_because(incomplete_words(path))}: expected one"
                )
            self.rate_hz = capture.rate_hz
        self.count = int(stated) if 0 < stated < 2**31 else None

    def __iter__(self) -> Iterator[Frame]:
        with closing(_Capture(self._path, self._upright)) as capture:
            number, time_s = 0, -1.0
            for pixels in capture.frames():
                if self._is_closed.is_set():
                    return
                stamp_s = capture.video.get(cv2.CAP_PROP_POS_MSEC) / 1000
                # Some containers have no time stamps.
                is_risen = math.isfinite(stamp_s) and (stamp_s > time_s or not number)
                time_s = stamp_s if is_risen else time_s + 1 / capture.rate_hz
                name = f"{self._path.stem}_{number:06d}"
                yield Frame(name, self._path, pixels, time_s=round(time_s, 3))
                number += 1
            self._check_end(number, capture.failures)

    def _check_end(self, read: int, failures: int) -> None:
        """Say what is missing."""
        of = f" of {self.count}" if self.count is not None and self.count > read else ""
        cut_off = incomplete_words(self._path)
        if cut_off is not None:
            self.counts["ended early"] = 1
            _log.warning("the video ended after %d%s frames: %s: %s", read, of, self.name, cut_off)
            return
        broken = max(failures, self._undecoded(read) if of else 0)
        if broken or (of and is_damaged(self._path)):
            self.counts["broken video frames"] = max(broken, 1)
            _log.warning(
                "the video is broken in its middle: %s: %d%s frames were read, expected a whole"
                " file",
                self.name,
                read,
                of,
            )

    def _undecoded(self, read: int) -> int:
        """Number of frames that are in the file and could not be decoded."""
        assert self.count is not None
        with closing(_Capture(self._path, self._upright)) as capture:
            packets, before = capture.packets()
        # What an edit list cuts away has times below 0.
        return (self.count if is_mp4(self._path) else packets) - before - read


class _Capture:
    """An open video.

    Attributes:
        video: What OpenCV opened.
        rate_hz: Frames per second that it states, or 25.
        failures: Frames so far that could not be decoded, with others after them.
    """

    def __init__(self, path: Path, upright: bool) -> None:
        if not is_video(path):  # FFmpeg might follow what a text says
            raise _not_a_video(path)
        self.video = open_video(path, upright=upright)
        if not self.video.isOpened():
            raise _not_a_video(path)
        self._check_size(path)
        rate_hz = self.video.get(cv2.CAP_PROP_FPS)
        usual = _RATES_HZ[0] <= rate_hz <= _RATES_HZ[1]
        self.rate_hz = rate_hz if usual else _DEFAULT_RATE_HZ
        self.failures = 0

    def _check_size(self, path: Path) -> None:
        """Raise InputError if its pictures are larger than `Limits` allows."""
        width = int(self.video.get(cv2.CAP_PROP_FRAME_WIDTH))
        height = int(self.video.get(cv2.CAP_PROP_FRAME_HEIGHT))
        largest = current_limits().image_pixels
        if width * height > largest:
            raise InputError(
                f"video {path} is {width}x{height} px: expected at most {largest} pixels, the limit"
                " image_pixels"
            )

    def has_frame(self) -> bool:
        """Whether one of the first frames can be decoded."""
        return any(self.video.grab() for _ in range(_MOST_FAILURES))

    def frames(self) -> Iterator[np.ndarray]:
        """(H, W, 3) uint8 BGR of each frame; goes on after those that cannot be decoded."""
        failures = 0
        while failures < _MOST_FAILURES:
            found, image = self.video.read()
            if not found:
                failures += 1
                continue
            self.failures, failures = self.failures + failures, 0
            yield np.asarray(image, dtype=np.uint8)

    def packets(self) -> tuple[int, int]:
        """Number of coded frames, without decoding them, and of those with times below 0."""
        if not self.video.set(cv2.CAP_PROP_FORMAT, -1):
            return 0, 0
        packets = before = failures = 0
        while failures < _MOST_FAILURES:
            if self.video.grab():
                packets += 1
                before += self.video.get(cv2.CAP_PROP_POS_MSEC) < 0
                failures = 0
            else:
                failures += 1
        return packets, before

    def close(self) -> None:
        self.video.release()


def _not_a_video(path: Path) -> InputError:
    return InputError(
        f"source {path} cannot be read{_because(incomplete_words(path))}: expected an image, a"
        " folder of images, or a video (MP4, AVI, Matroska or another that OpenCV reads)"
    )


def _because(words: str | None) -> str:
    return "" if words is None else f", as {words}"


def _turn_words(turn_deg: int, upright: bool) -> str:
    taken = "turned upright, as no camera is given"
    if not upright:
        taken = "taken as stored, those of the camera"
    return f"to be turned by {turn_deg} degrees: the frames are {taken}"
