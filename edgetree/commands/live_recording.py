"""The options of `edgetree live` that record its input, and the signal that marks."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.program.console import note

if TYPE_CHECKING:
    from edgetree.live.recording import FrameRecorder

__all__ = ["LiveRecordOptions"]

_Record: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Record the input of the seconds around each mark here. A mark is the button of"
        " --page, POST /mark, or the signal SIGUSR1.",
    ),
]
_RecordAll: TypeAlias = Annotated[
    bool, typer.Option("--record-all", help="Record all input in the folder of --record.")
]


@dataclass(frozen=True)
class LiveRecordOptions:
    """The options about recordings of the input."""

    record: _Record = None
    record_all: _RecordAll = False

    @contextmanager
    def recording(self, about: Callable[[], dict[str, Any]]) -> Iterator[FrameRecorder | None]:
        """Record during a block; yields None if it is not wanted.

        Args:
            about: returns what recordings say about the run.

        Raises:
            InputError: the folder is a file, or is missing for `--record-all`.
            MissingPackage: rosbags is not installed.
        """
        from basetree.errors import InputError
        from edgetree.live.recording import FrameRecorder

        if self.record is None:
            if self.record_all:
                raise InputError("--record-all given without --record: expected both")
            yield None
            return
        recorder = FrameRecorder(self.record, everything=self.record_all, about=about())
        try:
            with _marked_by_signal(recorder):
                yield recorder
        finally:
            recorder.close()
            if recorder.status.written or recorder.status.failed:
                note(f"{recorder.status.line()} in {self.record}")


@contextmanager
def _marked_by_signal(recorder: FrameRecorder) -> Iterator[None]:
    """Mark at each SIGUSR1 during a block, where the system has it."""
    number = getattr(signal, "SIGUSR1", None)
    if number is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(number, lambda *_: recorder.mark("SIGUSR1"))
    try:
        yield
    finally:
        signal.signal(number, before)
