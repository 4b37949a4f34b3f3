"""The frames between the loop that measures and the thread that writes recordings."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple

from basetree.counts import kind_of_line
from edgetree.live.results import LiveResult

_log = logging.getLogger(__name__)

_MIB: Final = 2**20
_SILENCE_S: Final = 2.0  # of a camera, until a recording in progress ends without it


@dataclass(eq=False)
class Window:
    """The frames of one recording, and its marks.

    Attributes:
        next_serial: Number of the next frame to write.
        until_s: Time of the last frame, s, in the clock of the frames.
        wait_until_s: When frames that do not come are given up, s of `time.monotonic`.
        marks: Time of each mark, s, in the clock of the frames, and what is recorded of it.
    """

    next_serial: int
    until_s: float
    wait_until_s: float = math.inf
    marks: list[tuple[float, dict[str, Any]]] = field(default_factory=list)


class FrameQueue:
    """Keeps the frames of the last seconds, and hands those around marks to the writer.

    Args:
        before_s: Time before a mark, s.
        after_s: Time after a mark, s.
        everything: Whether all frames are written.
        max_mib: Limit of the frames in memory, MiB.
        waits: Whether `put` waits for the writer instead of leaving out frames.

    Attributes:
        left_out: Frames that the writer was too slow for.
    """

    def __init__(
        self, before_s: float, after_s: float, *, everything: bool, max_mib: int, waits: bool
    ) -> None:
        self.waits, self.left_out = waits, 0
        self._before_s, self._after_s, self._max_bytes = before_s, after_s, max_mib * _MIB
        self._everything = everything
        self._kept = _KeptFrames()
        self._window: Window | None = None
        self._pause_until_s = 0.0
        self._newest: dict[str, Any] = {}
        self._said: set[str] = set()
        self._stop_s: float | None = None
        self._changed = threading.Condition()  # its lock can be taken again by a signal handler

    @property
    def is_recording(self) -> bool:
        """Whether a recording is in progress."""
        return self._window is not None

    def put(self, result: LiveResult) -> None:
        """Keep a frame."""
        with self._changed:
            if self._stop_s is not None:
                return
            self._kept.tick(result.frame.stamp_s)
            self._forget_old()
            if not self._has_room(_size_bytes(result)):
                return
            kept = self._kept.add(result)
            self._newest = {"frame": result.frame.number, "time_s": result.frame.time_s}
            if self._everything and self._window is None and kept.at_s >= self._pause_until_s:
                self._window = Window(kept.serial, math.inf)
            self._changed.notify_all()

    def mark(self, text: str) -> float:
        """Have the seconds around now written; returns how much time before is kept, s."""
        mark = {"text": text, "time": datetime.now(UTC).isoformat(timespec="milliseconds")}
        with self._changed:
            first_s = self._kept.now_s - self._before_s
            now_s, oldest = self._kept.now_s, self._kept.first_at(first_s)
            if self._window is None:
                until_s = math.inf if self._everything and now_s >= self._pause_until_s else now_s
                self._window = Window(0 if oldest is None else oldest.serial, until_s)
            window = self._window
            window.until_s = max(window.until_s, now_s + self._after_s)
            if not (self.waits or self._everything):
                window.wait_until_s = time.monotonic() + self._after_s + _SILENCE_S
            window.marks.append((now_s, mark | self._newest))
            self._changed.notify_all()
            return 0.0 if oldest is None else now_s - oldest.at_s

    def next_window(self) -> Window | None:
        """Wait for the next recording; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._window or self._stop_s is not None)
            return self._window

    def next_frame(self, window: Window) -> KeptFrame | None:
        """Wait for the next frame of a recording; None at its end."""
        with self._changed:
            while not self._is_out_of_time():
                kept = self._kept.first_from(window.next_serial)
                if kept is not None and kept.at_s <= window.until_s:
                    window.next_serial = kept.serial + 1
                    self._changed.notify_all()
                    return kept
                left_s = window.wait_until_s - time.monotonic()
                if kept is not None or self._stop_s is not None or left_s <= 0:
                    break
                self._changed.wait(None if left_s == math.inf else left_s)
            self.left_out += sum(map(self._is_pending, self._kept))
            self._window = None
            return None

    def take_marks(self, window: Window, end_s: float) -> list[dict[str, Any]]:
        """The marks of a recording before a time, s, each once."""
        with self._changed:
            marks = [mark for at_s, mark in window.marks if at_s < end_s]
            window.marks = window.marks[len(marks) :]
            return marks

    def give_up(self, pause_s: float) -> None:
        """End a recording that cannot be written; if all is recorded, begin anew after a pause."""
        with self._changed:
            self._window = None
            self._pause_until_s = self._kept.now_s + pause_s
            self._changed.notify_all()

    def end(self, wait_s: float) -> None:
        """Take no more frames. The writer gets what is left for so long, s."""
        with self._changed:
            if self._stop_s is None:
                self._stop_s = time.monotonic() + wait_s
                self._changed.notify_all()

    def _is_out_of_time(self) -> bool:
        return self._stop_s is not None and time.monotonic() >= self._stop_s

    def _is_pending(self, kept: KeptFrame) -> bool:
        """Whether a frame is to be written."""
        window = self._window
        if window is None:
            return False
        return kept.serial >= window.next_serial and kept.at_s <= window.until_s

    def _forget_old(self) -> None:
        """Forget frames that are too old for a mark."""
        first_s = self._kept.now_s - self._before_s
        while (kept := self._kept.oldest) and kept.at_s < first_s and not self._is_pending(kept):
            self._kept.drop_oldest()

    def _has_room(self, needed_bytes: int) -> bool:
        """Make room for a frame; False if there is none, as the writer is too slow."""
        while self._kept.size_bytes + needed_bytes > self._max_bytes:
            oldest = self._kept.oldest
            if oldest is None:
                return True  # one frame is always kept
            if not self._is_pending(oldest):
                self._say_short(self._kept.now_s - oldest.at_s)
                self._kept.drop_oldest()
            elif self.waits and self._stop_s is None:
                self._changed.wait()
                self._forget_old()
            else:
                self.left_out += 1
                self._say("frames are missing in recordings: the disk or the processor is too slow")
                return False
        return True

    def _say_short(self, span_s: float) -> None:
        self._say(
            f"{self._max_bytes // _MIB} MiB hold the frames of {span_s:.1f} s: recordings begin so"
            f" long before a mark, not {self._before_s:g} s"
        )

    def _say(self, line: str) -> None:
        """Log a warning once; lines that differ in numbers alone count as one."""
        key = kind_of_line(line)
        if key not in self._said:
            self._said.add(key)
            _log.warning("%s", line)


class KeptFrame(NamedTuple):
    """A result with its frame.

    Attributes:
        serial: Its number, from 0 on.
        at_s: Its time, s, in a clock that never goes back.
        result: The result.
        size_bytes: What its arrays take.
    """

    serial: int
    at_s: float
    result: LiveResult
    size_bytes: int


class _KeptFrames:
    """Keeps references to results.

    Attributes:
        now_s: Time of the newest frame, s: the sum of the steps of the time stamps, without those
            back, as of a camera that starts again.
        size_bytes: What all arrays take.
    """

    def __init__(self) -> None:
        self.now_s = 0.0
        self.size_bytes = 0
        self._frames: deque[KeptFrame] = deque()
        self._serial = 0
        self._stamp_s: float | None = None

    @property
    def oldest(self) -> KeptFrame | None:
        """The oldest frame."""
        return self._frames[0] if self._frames else None

    def __iter__(self) -> Iterator[KeptFrame]:
        return iter(self._frames)

    def tick(self, time_s: float) -> None:
        """Set the clock to the time stamp of a new frame, s."""
        if self._stamp_s is not None:
            self.now_s += max(time_s - self._stamp_s, 0.0)
        self._stamp_s = time_s

    def add(self, result: LiveResult) -> KeptFrame:
        """Keep a result, at the time of the clock."""
        kept = KeptFrame(self._serial, self.now_s, result, _size_bytes(result))
        self._serial += 1
        self._frames.append(kept)
        self.size_bytes += kept.size_bytes
        return kept

    def drop_oldest(self) -> None:
        """Forget the oldest frame."""
        self.size_bytes -= self._frames.popleft().size_bytes

    def first_at(self, at_s: float) -> KeptFrame | None:
        """The first frame of this time or later, s."""
        return next((kept for kept in self if kept.at_s >= at_s), None)

    def first_from(self, serial: int) -> KeptFrame | None:
        """The first frame with this number or a higher one."""
        return next((kept for kept in self if kept.serial >= serial), None)


def _size_bytes(result: LiveResult) -> int:
    """What the arrays of a result take."""
    frame = result.frame
    arrays = (frame.image, frame.depth_m, frame.filled_depth_m, frame.cloud_m, result.trees.masks)
    return sum(array.nbytes for array in arrays if array is not None)
