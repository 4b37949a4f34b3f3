"""Progress of a job on stderr: rate, cost and time left."""

from __future__ import annotations

import time

from basetree.counts import counted
from basetree.program.console import StatusLine, note
from basetree.program.progress import duration


class Progress:
    """Tells how far a job is, as `StatusLine` does.

    Frames of an earlier run count as done, but not for rate and cost.

    Args:
        doing: What is done, such as "simulating".
        cores: Cores that a unit keeps busy.
        shown: Whether to tell anything.
    """

    def __init__(self, doing: str, cores: int = 1, shown: bool = True) -> None:
        self._doing, self._cores, self._shown = doing, cores, shown
        self._line = StatusLine(shown)
        self._total = self._done = self._earlier = 0
        self._busy_s = 0.0
        self._start_s = 0.0

    def begin(self, total: int, done: int) -> None:
        """Begin to count.

        Args:
            total: Number of all frames.
            done: Number of frames that an earlier run has finished.
        """
        self._total, self._done, self._earlier = total, done, done
        self._start_s = time.monotonic()
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
        if self._done < self._total:
            self._line.show(self.line)
        else:
            self.say(self.line())

    def say(self, text: str) -> None:
        """Print a line beside the progress."""
        if self._shown:
            note(text)

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
