"""Play a recording as a camera would deliver it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

from edgetree.live.frames import LiveFrame, LiveSource

__all__ = ["PacedSource"]

_LONGEST_GAP_S = 5.0  # a longer gap between two stamps is a jump of the clock


class PacedSource:
    """A recording that yields each frame at its time, as a camera does.

    Frames that are not taken in time are lost.

    Args:
        source: the recording.
    """

    is_live = True

    def __init__(self, source: LiveSource) -> None:
        self._source = source
        self._closed = threading.Event()
        self.name = source.name

    @property
    def counts(self) -> dict[str, int]:
        """What the recording left out."""
        return self._source.counts

    def __iter__(self) -> Iterator[LiveFrame]:
        due_s, last_s = time.monotonic(), None
        for frame in self._source:
            gap_s = 0.0 if last_s is None else frame.time_s - last_s
            last_s = frame.time_s
            due_s += gap_s if 0 <= gap_s <= _LONGEST_GAP_S else 0.0
            due_s = max(due_s, time.monotonic() - _LONGEST_GAP_S)
            if self._closed.wait(max(0.0, due_s - time.monotonic())):
                return
            yield frame

    def close(self) -> None:
        """Close the recording."""
        self._closed.set()
        self._source.close()
