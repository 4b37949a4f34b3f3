"""Play a recording for ever, or as a camera would deliver it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

from edgetree.frames.frame import Frame
from edgetree.sources.source import BaseSource, FrameSource

_FIRST_STEP_S: Final = 1 / 30
_MAX_STEP_S: Final = 1.0
_LONGEST_PAUSE_S: Final = 86_400.0  # a longer one is a wrong stamp, or a clock that was set
_LONGEST_GAP_S: Final = 5.0  # played at its length; a longer gap is a jump of the clock


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


class _Played(BaseSource):
    """A source that is played in another way.

    Args:
        source: a recording or files; to be looped, they can be iterated over several times.
    """

    def __init__(self, source: FrameSource) -> None:
        super().__init__(source.name)
        self._source = source
        self.counts = source.counts  # type: ignore[assignment]

    def close(self) -> None:
        """End an iteration in progress."""
        super().close()
        self._source.close()


class Looped(_Played):
    """A source that starts again at its end, with numbers and time stamps that go on rising."""

    def __iter__(self) -> Iterator[Frame]:
        clock, start = RisingClock(), 0
        while not self._is_closed.is_set():
            number = -1
            for frame in self._source:
                number = number + 1 if frame.number is None else frame.number
                time_s = clock.rising_s(frame.stamp_s)
                yield replace(frame, number=start + number, time_s=time_s)
            if number < 0:
                return
            start += number + 1
            clock.restart()


class Changed(_Played):
    """A source whose frames go through a function.

    Args:
        source: A camera, a recording or files.
        change: Returns the frame to yield instead.
    """

    def __init__(self, source: FrameSource, change: Callable[[Frame], Frame]) -> None:
        super().__init__(source)
        self.is_live, self.count = source.is_live, source.count
        self._change = change

    def __iter__(self) -> Iterator[Frame]:
        return map(self._change, self._source)


class PacedSource(_Played):
    """A recording that yields each frame at its time, as a camera does.

    Frames that are not taken in time are lost.
    """

    is_live = True

    def __iter__(self) -> Iterator[Frame]:
        due_s, last_s = time.monotonic(), None
        for frame in self._source:
            gap_s = 0.0 if last_s is None else frame.stamp_s - last_s
            last_s = frame.stamp_s
            due_s += gap_s if 0 <= gap_s <= _LONGEST_GAP_S else 0.0
            due_s = max(due_s, time.monotonic() - _LONGEST_GAP_S)
            if self._is_closed.wait(max(0.0, due_s - time.monotonic())):
                return
            yield frame
