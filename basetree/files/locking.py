"""A lock between processes, for files that are read, changed and written again."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from basetree.errors import InputFileError

_POLL_S: Final = 0.02


@contextmanager
def locked(path: Path, wait_s: float = 10.0) -> Iterator[None]:
    """Hold the lock of a file, so that no other process or thread changes it in between.

    What is locked is an empty file beside it, with ".lock" added, which stays: the file itself is
    replaced when it is written. The system frees the lock of a process that ends, however it ends.

    Args:
        path: The file, which may not exist. Its folder must.
        wait_s: How long to wait for another holder, s.

    Raises:
        InputFileError: The lock cannot be made, or another process holds it for so long.
    """
    lock = Path(f"{path}.lock")
    try:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
    except OSError as error:
        raise InputFileError(f"{lock}: cannot be locked ({error.strerror})") from error
    try:
        _wait_for(descriptor, lock, wait_s)
        yield
    finally:
        os.close(descriptor)


def _wait_for(descriptor: int, lock: Path, wait_s: float) -> None:
    end_s = time.monotonic() + wait_s
    while True:
        try:
            _take(descriptor)
        except BlockingIOError as error:
            if time.monotonic() > end_s:
                raise InputFileError(
                    f"{lock}: another process holds this lock for {wait_s:g} s: expected it to be"
                    " free"
                ) from error
        except OSError as error:
            raise InputFileError(f"{lock}: cannot be locked ({error.strerror})") from error
        else:
            return
        time.sleep(_POLL_S)


def _take(descriptor: int) -> None:
    """Lock an open file; BlockingIOError if another holds it."""
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(error.errno, error.strerror) from error
        return
    import fcntl

    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
