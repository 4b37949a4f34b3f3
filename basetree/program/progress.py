"""The progress of steps that take long: how far, how fast, and how much time is left."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Final, TypeVar

from basetree.counts import counted
from basetree.program.console import StatusLine, note

_T = TypeVar("_T")
_TICK_S: Final = 0.5


class Progress:
    """Counts the units of a step, and shows rate and time left as `StatusLine` does.

    As a context manager it also shows the time so far while no unit is finished.

    Args:
        label: What is done, such as "simulating".
        total: Number of units; None if nobody knows it.
        noun: A unit.
        shown: Whether to show anything.
        done: Units that an earlier run finished, which do not count for the rate.
    """

    def __init__(
        self,
        label: str,
        total: int | None = None,
        noun: str = "frame",
        *,
        shown: bool = True,
        done: int = 0,
    ) -> None:
        self._label, self._total, self._noun = label, total, noun
        self._done = self._earlier = done
        self._start_s = time.monotonic()
        self._line = StatusLine(shown)
        self._is_ended = threading.Event()
        self._thread = threading.Thread(target=self._tick, name="edgetree-progress", daemon=True)

    def update(self, n_steps: int) -> None:
        """Count finished units."""
        self._done += n_steps
        self._line.show(self.text)

    def doing(self, label: str) -> None:
        """Say what is done now."""
        self._label = label
        self._line.show(self.text)

    def text(self) -> str:
        """What is shown."""
        taken_s, new = time.monotonic() - self._start_s, self._done - self._earlier
        text = self._label
        if self._total is not None:
            text += f": {self._done} of {counted(self._total, self._noun)}"
        elif self._done:
            text += f": {counted(self._done, self._noun)}"
        if new <= 0 or taken_s <= 0:
            return f"{text}, {duration(taken_s)} so far"
        rate = new / taken_s
        text += f", {rate:.1f} {self._noun}s/s" if rate >= 1 else f", {60 * rate:.2g} a minute"
        if self._total is None:
            return text
        left_s = (self._total - self._done) / rate
        return f"{text}, {duration(left_s)} left" if left_s > 0 else f"{text}, {duration(taken_s)}"

    def end(self) -> None:
        """Show the last state, if an earlier one was shown."""
        self._line.show(self.text, last=True)

    def __enter__(self) -> Progress:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_ended.set()
        self._thread.join()
        self.end()

    def _tick(self) -> None:
        while not self._is_ended.wait(_TICK_S):
            self._line.show(self.text)


def progress(label: str, steps: int, noun: str = "frame", *, shown: bool = True) -> Progress:
    """The progress of a number of steps, as a context manager."""
    return Progress(label, steps, noun, shown=shown)


def counter(label: str, *, shown: bool = True) -> Callable[[int, int], None]:
    """A function (done, total) that shows the progress from its first call to its last.

    What is done at the first call counts as done earlier. When all is done, the next call starts
    anew.
    """
    step: Progress | None = None

    def tell(done: int, total: int) -> None:
        nonlocal step
        if step is None:
            step = Progress(label, total, shown=shown, done=done)
        step.update(done - step._done)
        if done == total:
            step.end()
            step = None

    return tell


def track(
    items: Iterable[_T], label: str, count: int | None = None, *, shown: bool = True
) -> Iterator[_T]:
    """Yield the items and show the progress; `count` is their number if it is known."""
    with Progress(label, count, shown=shown) as step:
        for item in items:
            yield item
            step.update(1)


@contextmanager
def steps_shown(label: str, *, shown: bool = True) -> Iterator[Callable[[str], None]]:
    """Show how long a work takes whose steps are told.

    Args:
        label: What is done.
        shown: Whether to show anything.

    Yields:
        Takes what is done now, which is printed as a note, too.
    """

    def tell(text: str) -> None:
        if shown:
            note(text)
        step.doing(text)

    with Progress(label, shown=shown) as step:
        yield tell


def duration(seconds: float) -> str:
    """A time for people: seconds, minutes or hours."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
