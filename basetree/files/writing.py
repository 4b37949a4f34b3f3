"""Write files and folders whole: a reader sees the old content or the new, never a part of it.

The content is written under a random name `.calib-<16 hex digits>.part` in the same folder, and
renamed when it is complete. The operating system locks that file (`flock`) until then, and
releases the lock when the process ends, even if it is killed. A file of this form without a lock
is therefore a leftover, which the next process that writes to the folder removes.
"""

from __future__ import annotations

import errno
import io
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import cv2
from numpy.typing import NDArray

from basetree.errors import InputError, InputFileError

NOT_REGULAR = "not a regular file"
_TEMPORARY = re.compile(r"\.calib-[0-9a-f]{16}\.part")


class UnwritableFile(InputFileError, OSError):
    """A file that cannot be written.

    `errno`, `strerror` and `filename` are those of an `OSError` that names the file.
    """

    def __str__(self) -> str:
        return str(self.args[0])


@contextmanager
def replacing(path: Path, mode: int | None = None) -> Iterator[BinaryIO]:
    """Give the block a new file to write, which becomes `path` if the block succeeds.

    It is created before the block, and its content is on the disk before `path` changes. If the
    block raises, `path` is unchanged. A symbolic link at `path` is replaced, not followed.

    Args:
        path: File to write or replace.
        mode: Permissions of the file, such as 0o600; those of any new file if None.

    Raises:
        UnwritableFile: If the file cannot be created or written. And whatever the block raises.
    """
    with errors_naming(path):
        if (path.exists() and not path.is_file()) or is_stream(path):
            raise OSError(errno.EINVAL, NOT_REGULAR)
        _remove_leftovers_once(os.path.realpath(path.parent))
        temporary, descriptor = _new_file(path.parent, mode)
    stream = io.BufferedWriter(_OutputFile(descriptor, path))
    try:
        yield stream
        with errors_naming(path):
            stream.flush()
            os.fsync(descriptor)
            if sys.platform == "win32":  # which cannot rename open files
                stream.close()
            temporary.replace(path)
            sync_folder(path.parent)
    finally:
        with suppress(OSError):
            stream.close()
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def text_file(path: Path) -> Iterator[TextIO]:
    r"""Open a UTF-8 text file as in `replacing`. Line ends are not translated.

    Bytes of file names that are not UTF-8 are spelled out: `\udcff` for the byte ff.
    """
    with replacing(path) as stream:
        text = io.TextIOWrapper(stream, "utf-8", "backslashreplace", newline="")
        try:
            yield text
            text.flush()
        finally:
            with suppress(OSError):
                text.detach()  # or it would close the file


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """Give the block a new folder to fill, which becomes `path` if the block succeeds.

    An older folder at `path` is removed when the new one is in its place.

    Args:
        path: Folder to make or replace; its parent exists.

    Raises:
        UnwritableFile: If the folder cannot be made or replaced. And whatever the block raises.
    """
    with errors_naming(path):
        if path.name in ("", "..") or os.path.ismount(path):
            raise OSError(errno.EBUSY, "it is the current folder, one around it or a mounted one")
        _remove_leftovers_once(os.path.realpath(path.parent))
        temporary, lock = _new_folder(path.parent)
    try:
        yield temporary
        with errors_naming(path):
            _replace_folder(path, temporary)
            sync_folder(path.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        if lock is not None:
            os.close(lock)


@contextmanager
def replacing_named(path: Path) -> Iterator[Path]:
    """Give the block the path of a file for a library to write, which becomes `path` at its end.

    It has the same name, in a temporary folder beside `path`.

    Args:
        path: File to write or replace.

    Raises:
        UnwritableFile: If the folder cannot be made, or the file not be renamed. And whatever the
            block raises.
    """
    with errors_naming(path):
        if (path.exists() and not path.is_file()) or is_stream(path):
            raise OSError(errno.EINVAL, NOT_REGULAR)
        _remove_leftovers_once(os.path.realpath(path.parent))
        folder, lock = _new_folder(path.parent)
    try:
        yield folder / path.name
        with errors_naming(path):
            (folder / path.name).replace(path)
            sync_folder(path.parent)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def write_whole(path: Path, data: bytes, mode: int | None = None) -> None:
    """Write a file at once or not at all.

    Args:
        path: File to write or replace.
        data: Its content.
        mode: Permissions of the file, as for `replacing`.

    Raises:
        InputFileError: If it cannot be written.
    """
    try:
        with replacing(path, mode) as stream:
            stream.write(data)
    except UnwritableFile as error:
        raise InputFileError(f"{path}: cannot be written ({error.strerror})") from error


def write_text(path: Path, text: str) -> None:
    r"""Write a UTF-8 text file at once or not at all.

    Bytes of file names that are not UTF-8 are spelled out: `\udcff` for the byte ff.

    Raises:
        InputFileError: If it cannot be written.
    """
    write_whole(path, text.encode("utf-8", "backslashreplace"))


def write_image(path: Path, image: NDArray[Any], options: Sequence[int] = ()) -> None:
    """Write an image file at once or not at all.

    Args:
        path: File to write; its suffix is the format.
        image: (H, W) or (H, W, 3) BGR.
        options: Flags and values of `cv2.imwrite`.

    Raises:
        InputFileError: If it cannot be written.
    """
    try:
        data = cv2.imencode(path.suffix, image, options)[1].tobytes()
    except cv2.error as error:
        raise InputFileError(
            f"{path}: {image.dtype} {image.shape} cannot be written as a picture of that name:"
            " expected pixels (H, W) or (H, W, 3), and a name such as a.png"
        ) from error
    write_whole(path, data)


@contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """Create a folder if needed and check that it is writable.

    If the block raises, the folders created here are removed again, unless they contain files.

    Raises:
        InputError: If the folder cannot be created or is not writable.
    """
    made = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        _remove_empty(made)
        raise InputError(
            f"output folder {path} cannot be written ({error.strerror}):"
            " expected a writable folder, or one that can be created"
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


def is_stream(path: Path) -> bool:
    """Whether a path is a pipe or a device, or names a stream of a process, as /dev/stdout does.

    A link elsewhere that leads to one is only a link.
    """
    folder = Path(os.path.realpath(path.parent))
    if folder == Path("/dev") or folder.parts[1:2] == ("proc",):
        return path.exists()
    with suppress(OSError):
        kind = path.lstat().st_mode
        return not (stat.S_ISREG(kind) or stat.S_ISDIR(kind) or stat.S_ISLNK(kind))
    return False


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files and folders of killed processes from a folder.

    Those that a running process still writes are kept, and so are those on a disk without locks.
    """
    with suppress(OSError):
        for entry in list(os.scandir(folder)):
            if _TEMPORARY.fullmatch(entry.name):
                _remove_if_left(Path(entry.path))


@cache
def _remove_leftovers_once(folder: str) -> None:
    remove_leftovers(Path(folder))


class _OutputFile(io.FileIO):
    """A file to write whose errors name the file that it becomes."""

    def __init__(self, descriptor: int, path: Path) -> None:
        super().__init__(descriptor, "wb")
        self._path = path

    def write(self, data: Any) -> int:
        with errors_naming(self._path):
            return super().write(data)


@contextmanager
def errors_naming(path: Path) -> Iterator[None]:
    """Raise errors of the system in the block as `UnwritableFile`, which names the path."""
    try:
        yield
    except OSError as error:
        number = error.errno or errno.EIO
        raise _unwritable(path, number, error.strerror or os.strerror(number)) from error


def _unwritable(path: Path, number: int, reason: str) -> UnwritableFile:
    message = (
        f"{path} is a folder: expected the name of a file to write"
        if reason == NOT_REGULAR and path.is_dir()
        else f"{path} cannot be written ({reason}): expected a file in an existing, writable"
        " folder with space for it"
    )
    error = UnwritableFile(message)
    error.errno, error.strerror, error.filename = number, reason, str(path)
    return error


def _new_file(folder: Path, mode: int | None) -> tuple[Path, int]:
    """Create and lock a temporary file; returns its path and its descriptor."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    while True:
        temporary = _random_name(folder)
        descriptor = os.open(temporary, flags, 0o666 if mode is None else mode)
        if mode is not None and sys.platform != "win32":  # what the umask took away
            os.fchmod(descriptor, mode)
        _lock(descriptor, wait=True)
        if temporary.exists():  # not removed as a leftover before it was locked
            return temporary, descriptor
        os.close(descriptor)


def _new_folder(parent: Path) -> tuple[Path, int | None]:
    """Create and lock a temporary folder; returns its path and the descriptor of its lock."""
    while True:
        temporary = _random_name(parent)
        temporary.mkdir()
        if sys.platform == "win32":  # which cannot open folders
            return temporary, None
        with suppress(FileNotFoundError):
            descriptor = os.open(temporary, os.O_RDONLY)
            _lock(descriptor, wait=True)
            if temporary.exists():
                return temporary, descriptor
            os.close(descriptor)


def _replace_folder(path: Path, new: Path) -> None:
    """Rename a folder to `path`; one that is there is removed after that, or kept if it fails."""
    if path.is_symlink() or not path.is_dir():
        new.replace(path)
        return
    old, lock = _random_name(path.parent), None
    if sys.platform != "win32":  # which cannot open folders
        lock = os.open(path, os.O_RDONLY)
        _lock(lock, wait=False)  # so that no other process takes it for a leftover
    try:
        path.rename(old)
        try:
            new.replace(path)
        except OSError:
            old.rename(path)
            raise
        shutil.rmtree(old, ignore_errors=True)
    finally:
        if lock is not None:
            os.close(lock)


def _random_name(folder: Path) -> Path:
    return folder / f".calib-{secrets.token_hex(8)}.part"


def _lock(descriptor: int, wait: bool) -> bool:
    """Lock an open file or folder; False if another process holds the lock or there are none."""
    if sys.platform == "win32":
        return False
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _remove_if_left(path: Path) -> None:
    """Remove a temporary file or folder unless a process has it open."""
    if sys.platform == "win32":  # which does not remove open files
        with suppress(OSError):
            path.unlink()
        return
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        try:
            if not _lock(descriptor, wait=False):
                return
            if stat.S_ISDIR(os.fstat(descriptor).st_mode):
                shutil.rmtree(path)
            else:
                path.unlink()
        finally:
            os.close(descriptor)


def sync_folder(folder: Path) -> None:
    """Write a folder's entries to the disk, where the system can."""
    if sys.platform == "win32":
        return
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
