"""Pixels in POSIX shared memory, on Linux: the service's side and the Python client's.

The service copies by reading the memory as a file. A mapping would end the process if the other
program made the memory smaller meanwhile.
"""

from __future__ import annotations

import itertools
import mmap
import os
import stat
import sys
import time
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from edgetree.serve.handed import size_bytes
from edgetree.serve.messages import Colour, Depth

FOLDER: Final = Path("/dev/shm")
IS_THERE: Final = sys.platform == "linux" and FOLDER.is_dir()

UNREADABLE: Final = "shared memory"
"""How an error begins after which new memory has to be made."""

_PREFIX: Final = "edgetree-"
_MOST_OPEN: Final = 4
_LEFT_BEHIND_S: Final = 60.0
_NUMBERS: Final = itertools.count()


class OpenMemories:
    """The shared memory that the service has open, of the program that hands frames over."""

    def __init__(self) -> None:
        self._open: OrderedDict[str, int] = OrderedDict()

    def read(self, image: Colour | Depth) -> NDArray[Any]:
        """Copy the pixels of an image whose `memory` is not None.

        Raises:
            InputError: There is no such memory, or it is too small.
        """
        assert image.memory is not None
        name, offset = image.memory.name, image.memory.offset
        shape, kind = image.array_type
        pixels = np.empty(shape, kind)
        expected = size_bytes(image)
        try:
            count = os.preadv(self._file(name), [pixels.data.cast("B")], offset)
        except OSError as error:
            raise InputError(
                f"{UNREADABLE} {name} cannot be read ({error.strerror}): expected some that is new"
                " to this service"
            ) from error
        if count != expected:
            raise InputError(
                f"{UNREADABLE} {name} has {count} bytes from byte {offset} on: expected {expected}"
            )
        return pixels

    def _file(self, name: str) -> int:
        """The open file of a name; the name is removed when it is opened."""
        if name in self._open:
            self._open.move_to_end(name)
            return self._open[name]
        path = FOLDER / name.removeprefix("/")
        flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
        file = os.open(path, flags)
        if not stat.S_ISREG(os.fstat(file).st_mode):
            os.close(file)
            raise InputError(f"{UNREADABLE} {name} is something else: expected some of shm_open")
        with suppress(OSError):
            path.unlink()
        self._open[name] = file
        if len(self._open) > _MOST_OPEN:
            os.close(self._open.popitem(last=False)[1])
        return file

    def close(self) -> None:
        """Release all memory."""
        while self._open:
            os.close(self._open.popitem()[1])


def remove_left_behind() -> int:
    """Remove shared memory that a killed program left before any service read it.

    Memory of this user that is older than a minute; a program that still waits with it makes new
    one when the service asks for it.

    Returns:
        How many were removed.
    """
    count = 0
    for path in FOLDER.glob(f"{_PREFIX}*") if IS_THERE else ():
        with suppress(OSError):
            about = path.lstat()
            is_own = stat.S_ISREG(about.st_mode) and about.st_uid == os.getuid()
            if is_own and time.time() - about.st_mtime > _LEFT_BEHIND_S:
                path.unlink()
                count += 1
    return count


class Slot:
    """Shared memory of a client for the pixels of one frame at a time.

    Attributes:
        name: As for `shm_open`; empty before the first frame.
        was_read: Whether a service has read it.
    """

    def __init__(self) -> None:
        self.name = ""
        self.was_read = False
        self._memory: mmap.mmap | None = None

    def write(self, arrays: Sequence[NDArray[Any]]) -> list[int]:
        """Copy arrays one after the other; returns the byte at which each begins.

        Raises:
            OSError: There is not so much shared memory.
        """
        needed = sum(array.nbytes for array in arrays)
        if self._memory is None or len(self._memory) < needed:
            self.close()
            self._memory = self._made(needed)
        offsets, place = [], 0
        for array in arrays:
            target = np.frombuffer(self._memory, array.dtype, array.size, place)
            np.copyto(target.reshape(array.shape), array)
            offsets.append(place)
            place += array.nbytes
        return offsets

    def _made(self, size: int) -> mmap.mmap:
        """New memory of a size, with a new name."""
        self.was_read = False
        self.name = f"/{_PREFIX}{os.getpid()}-{next(_NUMBERS)}-{time.monotonic_ns()}"
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        file = os.open(FOLDER / self.name.removeprefix("/"), flags, 0o600)
        try:
            os.posix_fallocate(file, 0, size)
            return mmap.mmap(file, size)
        except OSError:
            self._remove()
            raise
        finally:
            os.close(file)

    def close(self) -> None:
        """Release the memory, and its name if no service has read it."""
        if self._memory is not None:
            with suppress(BufferError):
                self._memory.close()
            self._memory = None
            self._remove()

    def _remove(self) -> None:
        with suppress(OSError):
            (FOLDER / self.name.removeprefix("/")).unlink()
