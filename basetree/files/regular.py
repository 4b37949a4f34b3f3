"""Open regular files alone: a named pipe would wait, and a device would never end."""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path

# A named pipe without a writer would wait while it is opened. Windows has none of these flags but
# the last.
_FLAGS = os.O_RDONLY
for _name in ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY"):
    _FLAGS |= getattr(os, _name, 0)

_BLOCK_BYTES = 2**20
_KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
    stat.S_IFDIR: "a folder",
}


def open_regular(path: Path | str) -> io.BufferedReader:
    """Open a regular file for reading bytes.

    Pipes are not read, so that /dev/stdin and process substitution need a file in between.

    Raises:
        OSError: If it cannot be opened, or is a folder, a named pipe, a socket or a device; its
            `strerror` says which.
    """
    try:
        return open(path, "rb", opener=_opened)
    except ValueError as error:  # a NUL in the path
        raise OSError(errno.EINVAL, f"not a path, {error}", str(path)) from error


def _opened(path: str, _: int) -> int:
    """The descriptor of a regular file. Only the file that takes it closes it.

    A second owner would close it again if an interrupt came as the file is made, and the error of
    that would hide the interrupt.
    """
    try:
        descriptor = os.open(path, _FLAGS)
    except OSError as error:
        if error.errno == errno.ENXIO:  # what Linux says of a socket
            raise _not_regular(error.errno, stat.S_IFSOCK, path) from error
        raise
    kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
    if kind != stat.S_IFREG:
        os.close(descriptor)
        code = errno.EISDIR if kind == stat.S_IFDIR else errno.EINVAL
        raise _not_regular(code, kind, path)
    return descriptor


def read_regular(path: Path | str, largest_bytes: int | None = None) -> bytes:
    """Read the content of a regular file.

    Args:
        path: The file.
        largest_bytes: Files with more bytes are refused; None for no limit.

    Raises:
        OSError: As for `open_regular`, or if the file is larger.
    """
    with open_regular(path) as file:
        if largest_bytes is None:
            return file.read()
        size = os.fstat(file.fileno()).st_size
        data = file.read(min(size, largest_bytes) + 1)  # which takes memory for so many
        while len(data) <= largest_bytes and (more := file.read(_BLOCK_BYTES)):
            data += more  # the file grows, or its system does not know its size
    if len(data) > largest_bytes:
        raise OSError(errno.EFBIG, f"larger than {largest_bytes} bytes", str(path))
    return data


def _not_regular(code: int, kind: int, path: str) -> OSError:
    words = _KINDS.get(kind, "of an unknown kind")
    return OSError(code, f"{words}, expected a regular file", path)
