"""The frames of the last seconds, in memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from edgetree.live.results import LiveResult

__all__ = ["KeptFrame", "KeptFrames"]


class KeptFrame(NamedTuple):
    """A result with its frame.

    Attributes:
        serial: its number, from 0 on.
        at_s: its time, s, in a clock that never goes back.
        result: the result.
        size_bytes: what its arrays take.
    """

    serial: int
    at_s: float
    result: LiveResult
    size_bytes: int


class KeptFrames:
    """Keeps references to results.

    Attributes:
        now_s: time of the newest frame, s: the sum of the steps of the time stamps, without those
            back, as of a camera that starts again.
        size_bytes: what all arrays take.
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
        kept = KeptFrame(self._serial, self.now_s, result, size_bytes(result))
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


def size_bytes(result: LiveResult) -> int:
    """What the arrays of a result take."""
    arrays = (result.frame.image, result.frame.depth_m, result.trees.masks)
    return sum(array.nbytes for array in arrays if array is not None)
