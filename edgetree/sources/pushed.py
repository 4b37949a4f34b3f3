"""Frames that a program hands over itself, such as from the callbacks of a driver or of ROS."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Final, Generic, TypeAlias, TypeVar

from edgetree.frames.frame import Frame

_T = TypeVar("_T")
_Bell: TypeAlias = "queue.SimpleQueue[None]"
_TURN_S: Final = 0.25  # Python handles a signal late, or never, in a wait without end


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

    An interrupt (`KeyboardInterrupt`) may come anywhere in the main thread. Its lock is one that no
    interrupt leaves locked, unlike that of `threading.Condition`, and it waits in turns.

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
        self._lock = threading.Lock()
        self._arrived: _Bell = queue.SimpleQueue()
        self._taken: _Bell = queue.SimpleQueue()
        self.dropped = 0

    def put(self, value: _T) -> bool:
        """Hand a value over; returns False if the other side has ended."""
        while True:
            with self._lock:
                if self._is_ended:
                    return False
                if self._newest_only or not self._values:
                    replaced, self._values = self._values, [value]
                    self.dropped += len(replaced)
                    break
            _wait(self._taken)
        if not replaced:
            _ring(self._arrived)
        elif self._on_replaced is not None:
            self._on_replaced(replaced[0])
        return True

    def end(self, error: BaseException | None = None) -> None:
        """End the exchange, from either side. The other side takes what is left, then the error."""
        with self._lock:
            if not self._is_ended:
                self._is_ended, self._error = True, error
        _ring(self._arrived)
        _ring(self._taken)

    def __iter__(self) -> Iterator[_T]:
        """Take the values until the end.

        Raises:
            BaseException: The error that the exchange was ended with.
        """
        while True:
            with self._lock:
                taken, self._values = self._values, []
                is_ended, error = self._is_ended, self._error
            if taken:
                _ring(self._taken)
                yield taken[0]
            elif not is_ended:
                _wait(self._arrived)
            elif error is not None:
                raise error
            else:
                return


def _ring(bell: _Bell) -> None:
    """Wake who waits, or who will wait next; one bell is enough, so that none are heaped up."""
    if bell.empty():
        bell.put(None)


def _wait(bell: _Bell) -> None:
    """Wait for a bell, at most for a turn."""
    with suppress(queue.Empty):
        bell.get(timeout=_TURN_S)
