"""What all outputs of results have in common."""

from __future__ import annotations

import io
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Protocol, Self, TextIO, TypeVar

from basetree.errors import InputError
from basetree.files.writing import text_file
from edgetree.frames.pipeline import FrameResult

_Result_contra = TypeVar("_Result_contra", bound=FrameResult, contravariant=True)
_Result = TypeVar("_Result", bound=FrameResult)


class Sink(Protocol[_Result_contra]):
    """An output of results. Files appear at their path when the sink is closed."""

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
    """

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

    def _text(self, target: Path | TextIO, *, grows: bool) -> TextIO:
        """A text file, which grows as it is written or else appears whole; or an open stream."""
        if not isinstance(target, Path):
            return target
        return self._files.enter_context(growing_file(target) if grows else text_file(target))


@contextmanager
def growing_file(path: Path) -> Iterator[TextIO]:
    r"""Open a UTF-8 text file that is written in place. An older file is replaced.

    If the machine is switched off, it keeps what was written. The caller flushes after whole lines.
    Line ends are not translated, and bytes of file names that are not UTF-8 are spelled out:
    `\udcff` for the byte ff. Errors of writing name the file.

    Raises:
        InputError: The file cannot be created.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected the name of a file to write")
    try:
        raw = _NamedFile(path, "w")
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}): expected a file in an existing, writable"
            " folder"
        ) from error
    with io.TextIOWrapper(io.BufferedWriter(raw), "utf-8", "backslashreplace", newline="") as text:
        yield text


class _NamedFile(io.FileIO):
    """A file whose errors name it."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.name)) from error
