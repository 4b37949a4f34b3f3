"""Several outputs, of which one that fails stops alone."""

from __future__ import annotations

import errno
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Final, Self

from basetree.counts import counted
from basetree.errors import CheckFailed, EdgetreeError
from basetree.program.console import complain

# The same file takes results again when there is space, or when somebody reads the pipe.
_PASSING: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EPIPE, errno.EAGAIN)
# What disks do, unlike users: such a file is waited for.
_OF_DISKS: Final = (*_PASSING, errno.EROFS, errno.EIO, errno.ENXIO, errno.ENODEV, errno.ESTALE)
_OPEN_AGAIN_S: Final = 10.0
_MOST_STATES: Final = 100


@dataclass(eq=False)
class _Output:
    """An output, and how it went.

    Attributes:
        name: What the user calls it.
        make: Opens it.
        sink: The open output; None if it is not open.
        goes_on: Whether it is tried again after a failure.
        missing: Results that it lacks.
        fault: Why it takes no results now; None if it does.
        reason: Why results are missing, in words; empty if none are.
        is_there: Whether it holds the other results.
        next_try_s: When it may be opened again, s of `time.monotonic`.
        states: States of the service that it has not taken yet.
    """

    name: str
    make: Callable[[], Any]
    sink: Any = None
    goes_on: bool = False
    missing: int = 0
    fault: BaseException | None = None
    reason: str = ""
    is_there: bool = True
    next_try_s: float = 0.0
    states: deque[Any] = field(default_factory=lambda: deque(maxlen=_MOST_STATES))
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def is_lost(self) -> bool:
        """Whether it takes no more results."""
        return self.fault is not None and not self.goes_on

    def open(self, *, waits: bool) -> bool:
        """Open it; returns whether it failed by the disk, if `waits` says that this may be."""
        try:
            self._make()
        except (OSError, EdgetreeError) as error:
            cause = _of_system(error)
            if not waits or cause is None or cause.errno not in _OF_DISKS:
                raise
            self.goes_on = True
            self._stop(error, cause)
            return True
        return False

    def tell(self, state: Any) -> None:
        """Hand over a state, from any thread; an output that is at work takes it afterwards."""
        if not self.states or self.states[-1] is not state:
            self.states.append(state)
        if self._lock.acquire(blocking=False):
            try:
                self._tell_waiting()
            finally:
                self._lock.release()

    def write(self, result: Any) -> bool:
        """Write a result; returns whether the output fails from now on."""
        with self._lock:
            self._tell_waiting()
            return self._write(result)

    def _tell_waiting(self) -> None:
        tell = getattr(self.sink, "tell", None)
        while self.states:
            if tell is not None:
                try:
                    tell(self.states[0])
                except (OSError, EdgetreeError):
                    return  # it waits: the next result shows the fault
            elif self.sink is None:
                return
            self.states.popleft()

    def _write(self, result: Any) -> bool:
        is_due = self.sink is not None or (self.goes_on and time.monotonic() >= self.next_try_s)
        was_failing = self.fault is not None
        try:
            if is_due:
                if self.sink is None:
                    self._make()
                self.sink.write(result)
                self._say_again()
        except (OSError, EdgetreeError) as error:
            cause = _of_system(error)
            if cause is None:
                raise
            self._stop(error, cause)
        self.missing += self.fault is not None
        return self.fault is not None and not was_failing

    def close(self) -> bool:
        """Complete it; returns whether that failed."""
        try:
            with self._lock:
                self._tell_waiting()
                if self.sink is not None:
                    self.sink.close()
        except (OSError, EdgetreeError) as error:
            cause = _of_system(error)
            if cause is None:
                raise
            self._stop(error, cause)
            return True
        return False

    def discard(self, *raised: Any) -> None:
        """Close it without the files that appear whole, as its block raised an error."""
        with suppress(OSError, EdgetreeError):
            if hasattr(self.sink, "__exit__"):
                self.sink.__exit__(*raised)
            elif self.sink is not None:
                self.sink.close()

    def words(self, results: int) -> str:
        """What is missing of so many results."""
        if not self.is_there:
            return f"{self.name} is not written ({self.reason})"
        return f"{self.name} lacks {self.missing} of {counted(results, 'frame')} ({self.reason})"

    def _make(self) -> None:
        self.next_try_s = time.monotonic() + _OPEN_AGAIN_S
        self.sink = self.make()
        self.goes_on = getattr(self.sink, "goes_on", False)

    def _stop(self, error: BaseException, cause: OSError) -> None:
        self.fault, self.reason = error, cause.strerror or str(cause)
        if self.sink is None or (self.goes_on and cause.errno in _PASSING):
            return
        self.is_there = self.goes_on or not getattr(self.sink, "appears_whole", False)
        self.discard(type(error), error, error.__traceback__)
        self.sink = None

    def _say_again(self) -> None:
        if self.fault is not None:
            self.fault = None
            complain(f"{self.name} is written again, without {counted(self.missing, 'frame')}")


class GuardedOutputs:
    """Hands results to outputs. One that fails stops alone, with one line; the others go on.

    An output that grows as it is written is tried again with each result, and opened again, at most
    every 10 s, if its disk is gone. What is missing is counted.

    As a context manager, it completes each output at the end of the block; if the block raises,
    files that appear whole do not appear.

    Args:
        others: Whether the results go somewhere else too. If not, and the last output is lost, its
            error is raised.
    """

    def __init__(self, *, others: bool = False) -> None:
        self._outputs: list[_Output] = []
        self._others = others
        self._results = 0
        self._states: deque[Any] = deque(maxlen=_MOST_STATES)

    def open(self, name: str, make: Callable[[], Any], *, waits: bool = False) -> None:
        """Open an output.

        Args:
            name: What the user calls it.
            make: Opens it.
            waits: Whether a disk that fails is waited for.

        Raises:
            InputError: It cannot be opened. And whatever `make` raises.
        """
        output = _Output(name, make)
        if output.open(waits=waits):
            self._say(output)
        output.states.extend(self._states)
        self._outputs.append(output)

    def tell(self, state: Any) -> None:
        """Hand the state of the service to all outputs, from any thread.

        What is opened later gets the states before it.
        """
        if not self._states or self._states[-1] is not state:
            self._states.append(state)
        for output in tuple(self._outputs):
            output.tell(state)

    def write(self, result: Any) -> None:
        """Hand a result to all outputs.

        Raises:
            OSError: The last output is lost. And errors that are not of the system.
        """
        self._results += 1
        failed = [output for output in self._outputs if output.write(result)]
        if failed and not self._others and all(output.is_lost for output in self._outputs):
            assert failed[-1].fault is not None
            raise failed[-1].fault
        for output in failed:
            self._say(output)

    def close(self) -> None:
        """Complete each output. A second call does nothing.

        Raises:
            OSError: The only output cannot be completed.
        """
        failed: list[_Output] = []
        try:
            failed += [output for output in reversed(self._outputs) if output.close()]
        except BaseException as error:
            self._discard(type(error), error, error.__traceback__)
            raise
        if failed and not self._others and len(self._outputs) == 1:
            assert failed[-1].fault is not None
            raise failed[-1].fault
        for output in failed:
            complain(output.words(self._results))

    def holds(self, name: str) -> bool:
        """Whether an output of this name was opened, and holds the results that it got."""
        return any(each.name == name and each.is_there for each in self._outputs)

    def lacking(self) -> dict[str, int]:
        """How many results each output lacks, by its name; of a controller those not sent."""
        return {
            each.name: each.missing + int(getattr(each.sink, "lost", 0))
            for each in tuple(self._outputs)
        }

    def missing(self) -> list[str]:
        """What outputs lack, a line for each of them."""
        return [each.words(self._results) for each in self._outputs if each.reason]

    def check(self) -> None:
        """Raise CheckFailed if an output lacks results."""
        if lines := self.missing():
            raise CheckFailed("; ".join(lines))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self._discard(kind, error, trace)

    def _discard(self, *raised: Any) -> None:
        for output in reversed(self._outputs):
            output.discard(*raised)

    def _say(self, output: _Output) -> None:
        again = "it is tried again" if output.goes_on else "it is given up"
        complain(f"{output.name}: {output.reason}: {again}, and the other outputs go on")


def _of_system(error: BaseException) -> OSError | None:
    """The error of the system behind an error; None if there is none."""
    return next((each for each in (error, error.__cause__) if isinstance(each, OSError)), None)
