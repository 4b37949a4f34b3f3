"""Files and folders that grow as they are written, so that a killed process leaves what it wrote.

What is at their path is kept: an older file is moved aside, to `trees.1.csv` for `trees.csv`, or
the next number that is free.
"""

from __future__ import annotations

import _thread
import errno
import io
import logging
import os
import queue
import re
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from basetree.files.writing import errors_naming, is_stream, sync_folder

_log = logging.getLogger(__name__)

SYNC_EVERY_S: Final = 1.0
"""Time between two attempts to write a growing file to the disk, s."""

_LONGEST_SYNC_S: Final = 10.0
_NEW: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | getattr(os, "O_BINARY", 0)


class GrowingFile(io.TextIOBase):
    r"""A UTF-8 text file that is written in place, whole lines at a time.

    What was written since the last `flush` is written whole by the next one, or not at all. It
    survives the end of the process at once, and that of the machine after `SYNC_EVERY_S`. Line
    ends are not translated, and bytes of file names that are not UTF-8 are spelled out: `\udcff`
    for the byte ff. A file that is removed, or whose disk is, is told by the `flush` after that.

    An older file at the path is kept, see `keep_older`, and a symbolic link counts as one. Pipes,
    devices and the likes of /dev/stdout are written to as they are.

    Args:
        path: The file.

    Attributes:
        path: The file.

    Raises:
        UnwritableFile: The file cannot be created, or another process is writing it.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self._where = os.path.abspath(path)
        self._pending: list[str] = []
        self._fault: OSError | None = None
        self._is_synced = True
        # An interrupt may leave a `threading.Event` locked, and `Thread.start`. No lock here.
        self._closing: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._is_over: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._descriptor: int | None = None
        self._is_own = not is_stream(path)
        with errors_naming(path):
            self._descriptor = _new_file(path) if self._is_own else _stream(path)
        if self._is_own:
            _thread.start_new_thread(self._sync, ())

    def writable(self) -> bool:
        """Always true."""
        return True

    @property
    def is_empty(self) -> bool:
        """Whether the file holds nothing, as after a log rotation; false for pipes and devices."""
        descriptor = self._descriptor
        return self._is_own and descriptor is not None and not os.fstat(descriptor).st_size

    def write(self, text: str) -> int:
        """Take text for the next `flush`."""
        self._pending.append(text)
        return len(text)

    def flush(self) -> None:
        """Write what was taken, whole or not at all.

        Raises:
            OSError: It cannot be written, or earlier content did not reach the disk.
        """
        data = "".join(self._pending).encode("utf-8", "backslashreplace")
        self._pending.clear()
        if not data or self._descriptor is None:
            return
        try:
            self._write_whole(self._descriptor, data)
            fault, self._fault = self._fault, None
            if fault is not None:
                raise fault
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from error

    def close(self) -> None:
        """Write the rest to the disk. A second call does nothing.

        Raises:
            OSError: It cannot be written.
        """
        if self._descriptor is None:
            return
        try:
            self.flush()
            if self._is_own:
                self._closing.put(None)
                # A process that was forked has no such thread.
                with suppress(queue.Empty):
                    self._is_over.get(timeout=_LONGEST_SYNC_S)
                with errors_naming(self.path):
                    os.fsync(self._descriptor)
        finally:
            self._closing.put(None)
            descriptor, self._descriptor = self._descriptor, None  # an interrupt closes none twice
            os.close(descriptor)
            super().close()

    def _write_whole(self, descriptor: int, data: bytes) -> None:
        size_bytes = os.fstat(descriptor).st_size
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(descriptor, rest) :]
        except OSError:
            if self._is_own:  # no part of a line stays
                with suppress(OSError):
                    os.ftruncate(descriptor, size_bytes)
            raise
        self._is_synced = False

    def _sync(self) -> None:
        """The thread that waits for the disk, which may take its time."""
        try:
            while not self._is_closed_within(SYNC_EVERY_S):
                descriptor = self._descriptor
                if self._is_synced or descriptor is None:
                    continue
                self._is_synced = True
                try:
                    os.fsync(descriptor)
                    _check_is_there(descriptor, self._where)
                except OSError as error:
                    self._fault = error
        finally:
            self._is_over.put(None)

    def _is_closed_within(self, seconds: float) -> bool:
        with suppress(queue.Empty):
            self._closing.get(timeout=seconds)
            return True
        return False


def keep_older(path: Path) -> Path | None:
    """Move what is at a path aside, to NAME.1.SUFFIX or the next number that is free.

    A symbolic link is moved, not what it leads to. An empty file is removed.

    Args:
        path: A file, or the folder of a bag.

    Returns:
        Where it is now; None if there was nothing to keep.

    Raises:
        UnwritableFile: It cannot be moved, or another process is writing it.
    """
    if not os.path.lexists(path):
        return None
    with errors_naming(path), _unless_written(path):
        found = path.lstat()
        if stat.S_ISREG(found.st_mode) and not found.st_size:
            path.unlink()
            return None
        kept = _free_name(path)
        path.rename(kept)
        sync_folder(path.parent)
    _log.warning("%s was there: it is kept as %s", path, kept.name)
    return kept


class GrowingFolder:
    """A new folder that is called `unfinished_NAME` until it is complete.

    If the process is killed, it stays.

    Args:
        path: The folder to make; its parent exists.

    Attributes:
        unfinished: Where the files are until then.

    Raises:
        UnwritableFile: It cannot be made, with `errno.EEXIST` if one of the two names is taken.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.unfinished = path.with_name(f"unfinished_{path.name}")
        with errors_naming(path):
            self.unfinished.mkdir()
            if os.path.lexists(path):  # asked last, so that nobody else can have the two names
                self.unfinished.rmdir()
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))

    def complete(self) -> None:
        """Write the files to the disk and give the folder its name.

        Raises:
            UnwritableFile: That is not possible; the files stay where they are.
        """
        with errors_naming(self._path):
            for file in self.unfinished.iterdir():
                _sync_file(file)
            sync_folder(self.unfinished)
            self.unfinished.rename(self._path)
            sync_folder(self._path.parent)

    def discard(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.unfinished, ignore_errors=True)


def _new_file(path: Path) -> int:
    if path.is_dir() and not path.is_symlink():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    keep_older(path)
    descriptor = os.open(path, _NEW, 0o666)
    _is_locked(descriptor)
    sync_folder(path.parent)
    return descriptor


def _stream(path: Path) -> int:
    return os.open(path, os.O_WRONLY | os.O_APPEND)


def _check_is_there(descriptor: int, path: str) -> None:
    """Raise an OSError if a file is gone from its path, or another disk is there."""
    with suppress(PermissionError):
        try:
            is_there = os.lstat(path).st_dev == os.fstat(descriptor).st_dev
        except (FileNotFoundError, NotADirectoryError):
            is_there = False
        if not is_there:
            raise OSError(errno.ESTALE, "it was removed, or its disk was")


@contextmanager
def _unless_written(path: Path) -> Iterator[None]:
    """Raise BlockingIOError if another process has locked the file; keep others out meanwhile."""
    descriptor = None
    if path.is_file() and not path.is_symlink():
        with suppress(OSError):  # of a file that may not be read
            descriptor = os.open(path, os.O_RDONLY)
    try:
        if descriptor is not None and _is_locked(descriptor):
            raise BlockingIOError(errno.EBUSY, "another process is writing it")
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _is_locked(descriptor: int) -> bool:
    """Lock an open file; whether somebody else holds the lock. Some disks have no locks."""
    if sys.platform == "win32":
        return False
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _free_name(path: Path) -> Path:
    """The name with the number after the highest that is there."""
    numbered = re.compile(rf"{re.escape(path.stem)}\.(\d{{1,9}}){re.escape(path.suffix)}")
    found = (numbered.fullmatch(entry.name) for entry in os.scandir(path.parent))
    number = 1 + max((int(match[1]) for match in found if match), default=0)
    return path.with_name(f"{path.stem}.{number}{path.suffix}")


def _sync_file(path: Path) -> None:
    if path.is_file():
        descriptor = os.open(path, os.O_RDWR)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
