"""Repeat a recording for ever, with numbers and time stamps that go on rising."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterator
from typing import Final

from edgetree.live.frames import LiveFrame, LiveSource

__all__ = ["Looped", "RisingClock"]

_FIRST_STEP_S: Final = 1 / 30
_MAX_STEP_S: Final = 1.0
_LONGEST_PAUSE_S: Final = 86_400.0  # a longer one is a wrong stamp, or a clock that was set


class RisingClock:
    """Turns time stamps into ones that never fall: after a jump they go on from the last."""

    def __init__(self) -> None:
        self._offset_s = 0.0
        self._last_s: float | None = None
        self._step_s = _FIRST_STEP_S
        self._is_new = False

    def restart(self) -> None:
        """The next stamp is the first of another pass."""
        self._is_new = True

    def rising_s(self, stamp_s: float) -> float:
        """The stamp, moved so that it is later than the one before."""
        time_s = stamp_s + self._offset_s
        if self._last_s is not None:
            if self._is_new or not 0 < time_s - self._last_s <= _LONGEST_PAUSE_S:
                self._offset_s += self._last_s + self._step_s - time_s
                time_s = self._last_s + self._step_s
            else:
                self._step_s = min(time_s - self._last_s, _MAX_STEP_S)
        self._is_new = False
        self._last_s = time_s
        return time_s


class Looped:
    """A source that starts again at its end.

    Args:
        source: a source that can be iterated over several times, as files and recordings can.
    """

    is_live = False

    def __init__(self, source: LiveSource) -> None:
        self.name, self.counts = source.name, source.counts
        self._source = source
        self._is_closed = threading.Event()

    def __iter__(self) -> Iterator[LiveFrame]:
        clock, start = RisingClock(), 0
        while not self._is_closed.is_set():
            number = -1
            for frame in self._source:
                number = frame.number
                yield dataclasses.replace(
                    frame, number=start + number, time_s=clock.rising_s(frame.time_s)
                )
            if number < 0:
                return
            start += number + 1
            clock.restart()

    def close(self) -> None:
        """End an iteration in progress."""
        self._is_closed.set()
        self._source.close()
