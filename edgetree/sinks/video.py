"""Videos with the trees drawn."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Final

import cv2

from basetree.errors import InputError
from basetree.files.names import is_utf8
from basetree.files.writing import replacing_named
from edgetree.drawing.primitives import Picture
from edgetree.frames.pipeline import FrameResult
from edgetree.results.pictures import draw_frame
from edgetree.sinks.sink import FileSink

CODECS: Final = {
    **dict.fromkeys((".mp4", ".m4v", ".mov", ".mkv", ".ts"), "mp4v"),
    **dict.fromkeys((".mpg", ".mpeg"), "MPG2"),
    ".avi": "MJPG",
    ".webm": "VP80",
    ".wmv": "WMV2",
    ".flv": "FLV1",
}
"""The codec of each kind of file: one that the packages of OpenCV bring."""
_RATE_FRAMES: Final = 10  # from whose time stamps the rate follows, if the source states none
_USUAL_RATE_HZ: Final = 15.0


class VideoSink(FileSink[FrameResult]):
    """Draws each frame into a video, which appears when the sink is closed.

    Args:
        path: The file to write; its suffix is one of `CODECS`.
        rate_hz: Frames per second; None for those of the first time stamps.

    Raises:
        InputError: The file cannot be written, or the suffix is another.
    """

    def __init__(self, path: Path, rate_hz: float | None = None) -> None:
        super().__init__()
        if path.suffix.lower() not in CODECS or not is_utf8(path.resolve()):
            raise InputError(
                f"video {path} cannot be written: expected a name in UTF-8 that ends in"
                f" {', '.join(sorted(CODECS))}"
            )
        self._path, self._rate_hz = path, rate_hz
        self._writer: cv2.VideoWriter | None = None
        self._size_px = (0, 0)
        self._waiting: list[tuple[float | None, Picture]] = []
        self._temporary = self._files.enter_context(self._written())

    @contextmanager
    def _written(self) -> Iterator[Path]:
        with replacing_named(self._path) as temporary:
            try:
                yield temporary
                if self._waiting:
                    self._begin()
            finally:
                if self._writer is not None:
                    self._writer.release()
            self._check(temporary)

    def write(self, result: FrameResult) -> None:
        """Add a frame."""
        picture = draw_frame(result)
        if self._writer is not None:
            self._add(picture)
            return
        self._waiting.append((result.frame.time_s, picture))
        if self._rate_hz is not None or len(self._waiting) == _RATE_FRAMES:
            self._begin()

    def _begin(self) -> None:
        """Open the file and write the frames that waited for the rate."""
        pictures = [picture for _, picture in self._waiting]
        rate_hz = self._rate_hz or self._stamped_rate_hz()
        height, width = pictures[0].shape[:2]
        self._size_px = (width, height)
        even = (width + width % 2, height + height % 2)  # which codecs ask for
        suffix = self._path.suffix.lower()
        code = cv2.VideoWriter.fourcc(*CODECS[suffix])
        writer = cv2.VideoWriter(str(self._temporary), cv2.CAP_FFMPEG, code, rate_hz, even)
        if not writer.isOpened():
            raise InputError(
                f"video {self._path}: this OpenCV has no codec {CODECS[suffix]} for {suffix} files"
                f" of {width}x{height} px at {rate_hz:g} frames per second: expected another"
                " suffix, such as .avi"
            )
        self._writer, self._waiting = writer, []
        for picture in pictures:
            self._add(picture)

    def _stamped_rate_hz(self) -> float:
        times_s = [time_s for time_s, _ in self._waiting if time_s is not None]
        steps_s = [later - time_s for time_s, later in pairwise(times_s)]
        step_s = median(steps_s) if steps_s else 0.0
        return min(1 / step_s, 1000.0) if step_s > 0 else _USUAL_RATE_HZ

    def _add(self, picture: Picture) -> None:
        assert self._writer is not None
        height, width = picture.shape[:2]
        if (width, height) != self._size_px:
            raise InputError(
                f"video {self._path}: a frame is {width}x{height} px: expected"
                f" {self._size_px[0]}x{self._size_px[1]} px, as the first; `--out FOLDER` takes all"
            )
        self._writer.write(
            cv2.copyMakeBorder(picture, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
        )

    def _check(self, temporary: Path) -> None:
        """Raise InputError if nothing was written, which OpenCV does not tell of a full disk."""
        if self._writer is None:
            raise InputError(f"video {self._path}: no frame was drawn: expected one")
        if not temporary.is_file() or not temporary.stat().st_size:
            raise InputError(f"video {self._path} cannot be written: expected space on the disk")
