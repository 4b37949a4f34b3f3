"""Frames that a program hands over itself, such as from the callbacks of a driver or of ROS."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from edgetree.frames.frame import Frame

_T = TypeVar("_T")


class PushedFrames:
    """A live source whose frames another thread pushes. Only the newest frame is kept.

    Args:
        name: What messages call it.
    """

    is_live = True
    count = None

    def __init__(self, name: str) -> None:
        self.name = name
        self._frames: Handover[Frame] = Handover(newest_only=True)

    @property
    def counts(self) -> dict[str, int]:
        """Frames that were replaced before they were taken."""
        dropped = self._frames.dropped
        return {"replaced by a newer frame": dropped} if dropped else {}

    def push(self, frame: Frame) -> bool:
        """Hand over a frame, from any thread; returns False if the source is closed."""
        return self._frames.put(frame)

    def __iter__(self) -> Iterator[Frame]:
        return iter(self._frames)

    def close(self) -> None:
        """End the iteration after the frame that waits."""
        self._frames.end()


class Handover(Generic[_T]):
    """Holds at most one value between the thread that puts and the one that takes.

    Args:
        newest_only: Whether a new value replaces one that nobody took, instead of waiting.
        on_replaced: Called with each value that was replaced, in the thread that puts.

    Attributes:
        dropped: Number of values that were replaced.
    """

    def __init__(
        self,
        *,
        newest_only: bool = False,
        on_replaced: Callable[[_T], object] | None = None,
    ) -> None:
        self._newest_only = newest_only
        self._on_replaced = on_replaced
        self._values: list[_T] = []
        self._error: BaseException | None = None
        self._is_ended = False
        self._changed = threading.Condition()
        self.dropped = 0

    def put(self, value: _T) -> bool:
        """Hand a value over; returns False if the other side has ended."""
        replaced: list[_T] = []
        with self._changed:
            if self._newest_only and self._values:
                replaced, self._values = self._values, []
                self.dropped += 1
            self._changed.wait_for(lambda: self._is_ended or not self._values)
            if self._is_ended:
                return False
            self._values.append(value)
            self._changed.notify_all()
        if self._on_replaced is not None:
            for each in replaced:
                self._on_replaced(each)
        return True

    def end(self, error: BaseException | None = None) -> None:
        """End the exchange, from either side. The other side takes what is left, then the error."""
        with self._changed:
            if not self._is_ended:
                self._is_ended, self._error = True, error
                self._changed.notify_all()

    def __iter__(self) -> Iterator[_T]:
        """Take the values until the end.

        Raises:
            BaseException: The error that the exchange was ended with.
        """
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._is_ended or self._values)
                if not self._values:
                    if self._error is not None:
                        raise self._error
                    return
                value = self._values.pop()
                self._changed.notify_all()
            yield value
