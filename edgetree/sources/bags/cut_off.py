"""ROS 1 bags whose end is missing, as after a power failure.

The end of a bag holds an index. The complete records before it are read.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import NamedTuple

from basetree.files.regular import open_regular
from edgetree.sources.bags.bounded import BoundedFile, open_bounded
from edgetree.sources.bags.ros1_index import missing_index


class BagPath(NamedTuple):
    """A bag in the form of a `Path`, for rosbags: a file with another beginning and another end.

    Attributes:
        path: The file.
        head: Its first bytes.
        length: How many bytes of the file are used.
        tail: What follows them: the index.
        is_cut_off: Whether the file's own index is missing.
    """

    path: Path
    head: bytes
    length: int
    tail: bytes
    is_cut_off: bool

    @classmethod
    def of(cls, path: Path) -> BagPath:
        """A bag as it is, or with the index that it lacks."""
        with open_bounded(path) as file:
            index = missing_index(file, file.size)
            if index is None:
                return cls(path, b"", file.size, b"", False)
            return cls(path, index.head, index.length, index.tail, True)

    @property
    def size(self) -> int:
        """Its length in bytes."""
        return self.length + len(self.tail)

    def __str__(self) -> str:
        return str(self.path)

    def exists(self) -> bool:
        """Whether it exists, as rosbags asks."""
        return True

    def open(self, mode: str = "rb") -> BoundedFile:
        """Open it for reading."""
        if not self.is_cut_off:
            return open_bounded(self.path)
        return BoundedFile(_Joined(self.path, self.head, self.length, self.tail))


class _Joined(io.RawIOBase):
    """The first bytes of a file, the beginning replaced by `head`, followed by `tail`."""

    def __init__(self, path: Path, head: bytes, length: int, tail: bytes) -> None:
        self._file = open_regular(path)
        self._head, self._length, self._tail = head, length, tail
        self._position = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        starts = {io.SEEK_CUR: self._position, io.SEEK_END: self._length + len(self._tail)}
        self._position = max(0, starts.get(whence, 0) + offset)
        return self._position

    def tell(self) -> int:
        return self._position

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        at, wanted = self._position, len(buffer)
        if at < len(self._head):
            data = self._head[at : at + wanted]
        elif at < self._length:
            self._file.seek(at)
            data = self._file.read(min(self._length - at, wanted))
        else:
            start = at - self._length
            data = self._tail[start : start + wanted]
        buffer[: len(data)] = data
        self._position += len(data)
        return len(data)

    def close(self) -> None:
        self._file.close()
        super().close()
