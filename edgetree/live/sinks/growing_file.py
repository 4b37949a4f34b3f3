"""Files that grow line by line, so that a machine that is switched off keeps what was measured."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from basetree.errors import InputError

__all__ = ["growing_file"]


@contextmanager
def growing_file(path: Path) -> Iterator[TextIO]:
    r"""Open a UTF-8 text file that is written in place. An older file is replaced.

    The caller flushes after whole lines. Line ends are not translated, and bytes of file names that
    are not UTF-8 are spelled out: `\udcff` for the byte ff. Errors of writing name the file.

    Raises:
        InputError: the file cannot be created.
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
