"""Writing so that nobody ever finds half a file: beside first, renamed when whole."""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from edgetree.errors import InputError

__all__ = ["output_folder", "replacing"]


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a new empty file beside `path`; it becomes `path` if the block ends well.

    If the block raises, it is removed and `path` is as it was.

    Raises:
        InputError: the file cannot be made there.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected the name of a file to write")
    # Named before it is made, so that an interrupt at any moment finds it.
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        try:
            temporary.touch(exist_ok=False)
        except OSError as error:
            raise InputError(
                f"{path} cannot be written ({error.strerror}):"
                " expected a file in a folder that is there and can be written"
            ) from error
        yield temporary
        temporary.replace(path)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """Make the folder if needed and prove that it can be written, before any work is done.

    Folders made here are removed again if the block raises and left them empty.

    Raises:
        InputError: it cannot be made or written.
    """
    made = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        _remove_empty(made)
        raise InputError(
            f"output folder {path} cannot be written ({error.strerror}):"
            " expected a folder that is there, or can be made, and can be written"
        ) from error
    try:
        yield path
    except BaseException:
        _remove_empty(made)
        raise


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()
