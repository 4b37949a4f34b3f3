"""Progress of a job on stderr: rate, cost and time left."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from typing import TextIO

from basetree.counts import counted
from basetree.errors import one_line

_TERMINAL_S, _LINES_S = 0.5, 60.0


class Progress:
    """Tells how far a job is, on a terminal twice a second and otherwise once a minute.

    Frames of an earlier run count as done, but not for rate and cost.

    Args:
        doing: What is done, such as "simulating".
        cores: Cores that a unit keeps busy.
        shown: Whether to tell anything.
        stream: Where; stderr by default.
    """

    def __init__(
        self, doing: str, cores: int = 1, shown: bool = True, stream: TextIO | None = None
    ) -> None:
        self._doing, self._cores, self._shown = doing, cores, shown
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self._total = self._done = self._earlier = 0
        self._busy_s = 0.0
        self._start_s = self._next_s = 0.0

    def begin(self, total: int, done: int) -> None:
        """Begin to count.

        Args:
            total: Number of all frames.
            done: Number of frames that an earlier run has finished.
        """
        self._total, self._done, self._earlier = total, done, done
        self._start_s = time.monotonic()
        self._next_s = self._start_s + (_TERMINAL_S if self._terminal else _LINES_S)
        if done:
            self.say(f"{done} of {counted(total, 'frame')} are finished from an earlier run")

    def add(self, frames: int, busy_s: float) -> None:
        """Count a finished unit.

        Args:
            frames: Its frames.
            busy_s: Seconds that its worker took.
        """
        self._done += frames
        self._busy_s += busy_s
        is_last = self._done >= self._total
        now_s = time.monotonic()
        if now_s >= self._next_s or is_last:
            self._next_s = now_s + (_TERMINAL_S if self._terminal else _LINES_S)
            end = "\r" if self._terminal and not is_last else "\n"
            self._write(("\x1b[2K" if self._terminal else "") + self.line() + end)

    def say(self, text: str) -> None:
        """Print a line beside the progress."""
        self._write(("\x1b[2K" if self._terminal else "") + one_line(text) + "\n")

    def line(self) -> str:
        """What is shown: frames, rate, cost and time left."""
        text = f"{self._doing}: {self._done} of {counted(self._total, 'frame')}"
        new, taken_s = self._done - self._earlier, time.monotonic() - self._start_s
        if new <= 0 or taken_s <= 0:
            return text
        core_hours = self.core_hours_per_1000()
        left_s = (self._total - self._done) * taken_s / new
        left = "" if self._done >= self._total else f", {duration(left_s)} left"
        return (
            f"{text}, {60 * new / taken_s:.0f} frames/min,"
            f" {core_hours:.3g} core-hours per 1,000 frames{left}"
        )

    def core_hours_per_1000(self) -> float:
        """Core-hours of work for a thousand frames; 0 before the first frame."""
        new = self._done - self._earlier
        return self._busy_s * self._cores / 3.6 / new if new else 0.0

    def _write(self, text: str) -> None:
        if self._shown:
            with suppress(OSError):
                self._stream.write(text)
                self._stream.flush()


def duration(seconds: float) -> str:
    """A time for people: seconds, minutes or hours."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
