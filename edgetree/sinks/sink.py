"""What all outputs of results have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Generic, Protocol, Self, TextIO, TypeVar, cast

from basetree.files.growing import GrowingFile
from basetree.files.writing import text_file
from edgetree.frames.pipeline import FrameResult

_Result_contra = TypeVar("_Result_contra", bound=FrameResult, contravariant=True)
_Result = TypeVar("_Result", bound=FrameResult)


class Sink(Protocol[_Result_contra]):
    """An output of results. Files appear at their path when the sink is closed.

    A sink that also takes the state of the service has a method `tell(state)`, which is called at
    each change and every second, from any thread.
    """

    def write(self, result: _Result_contra) -> None:
        """Take the result of one frame.

        Raises:
            InputError: a file cannot be written. Errors of the network are logged and counted.
        """

    def close(self) -> None:
        """Complete the output. A second call does nothing.

        Raises:
            InputError: a file cannot be written.
        """


class FileSink(ABC, Generic[_Result]):
    """A sink into files, which are complete when it is closed.

    As a context manager, it is closed at the end of the block; if the block raises, files that
    appear whole do not appear.

    Attributes:
        appears_whole: Whether its files appear when it is closed.
        goes_on: Whether later results can be written after one that could not be.
    """

    appears_whole = True
    goes_on = False

    def __init__(self) -> None:
        self._files = ExitStack()

    @abstractmethod
    def write(self, result: _Result) -> None:
        """Take the result of one frame."""

    def close(self) -> None:
        """Complete the files."""
        self._files.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._files.__exit__(kind, error, trace)

    def _text(self, target: Path | str | TextIO, *, grows: bool) -> TextIO:
        """A text file, which grows as it is written or else appears whole; or an open stream."""
        if not isinstance(target, Path | str):
            return target
        target = Path(target)
        if grows:
            return cast("TextIO", self._files.enter_context(GrowingFile(target)))
        return self._files.enter_context(text_file(target))
