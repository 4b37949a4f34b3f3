"""Recordings whose end is missing, as after a power failure.

The end of an MCAP file and of a ROS 1 bag holds an index. The complete records before it are read.
The formats are described at https://mcap.dev/spec and https://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any, BinaryIO, Final

from basetree.files.regular import open_regular
from edgetree.sources.bags.ros1_index import ROS1_MAGIC, missing_index

_MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD_BYTES: Final = 9  # of a record: its kind and the length of its content
# What ends the records: zeros of a file that was not written to its end, a footer, or its data.
_END_KINDS: Final = (0x00, 0x02, 0x0F)
# A footer that states that there is no index.
_FOOTER: Final = b"\x02" + struct.pack("<QQQI", 20, 0, 0, 0) + _MCAP_MAGIC


class _CutOffFile:
    """A file with another beginning and another end, in the form of a `Path`."""

    def __init__(self, path: Path, head: bytes, length: int, tail: bytes) -> None:
        self._path, self._parts = path, (head, length, tail)
        self.suffix = path.suffix

    def __str__(self) -> str:
        return str(self._path)

    def exists(self) -> bool:
        return True

    def is_dir(self) -> bool:
        return False

    def open(self, mode: str = "rb") -> BinaryIO:
        return io.BufferedReader(_Joined(self._path, *self._parts))


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


def readable_file(path: Path) -> Any:
    """A file for rosbags' readers: the path, or what can be read of a file without its end."""
    with open_regular(path) as file:
        size = file.seek(0, io.SEEK_END)
        file.seek(0)
        start = file.read(len(ROS1_MAGIC))
        if path.suffix == ".mcap" and start.startswith(_MCAP_MAGIC):
            file.seek(max(0, size - len(_MCAP_MAGIC)))
            has_end = size > len(_MCAP_MAGIC) and file.read() == _MCAP_MAGIC
            return path if has_end else _CutOffFile(path, b"", _end_of_mcap(file, size), _FOOTER)
        if path.suffix == ".bag" and start == ROS1_MAGIC:
            index = missing_index(file, size)
            return path if index is None else _CutOffFile(path, *index)
    return path


def _end_of_mcap(file: BinaryIO, size: int) -> int:
    """Position after the last complete record."""
    position = len(_MCAP_MAGIC)
    while position + _HEAD_BYTES <= size:
        file.seek(position)
        kind, length = struct.unpack("<BQ", file.read(_HEAD_BYTES))
        if kind in _END_KINDS or position + _HEAD_BYTES + length > size:
            break
        position += _HEAD_BYTES + length
    return position
