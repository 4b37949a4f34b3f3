"""MCAP files whose end is missing, as after a power failure.

The end of an MCAP file holds an index. Without it, the complete records can still be read in their
order. The format is described at https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any, BinaryIO, Final

__all__ = ["mcap_file"]

_MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD_BYTES: Final = 9  # of a record: its kind and the length of its content
_END_KINDS: Final = (0x00, 0x02, 0x0F)  # zeros of a file that was not written, footer, end of data
# A footer that states that there is no index.
_FOOTER: Final = b"\x02" + struct.pack("<QQQI", 20, 0, 0, 0) + _MAGIC


class _CutOffFile:
    """The complete records of a file, and an end without an index, in the form of a `Path`."""

    def __init__(self, path: Path, length: int) -> None:
        self._path, self._length = path, length
        self.suffix = path.suffix

    def __str__(self) -> str:
        return str(self._path)

    def exists(self) -> bool:
        return True

    def is_dir(self) -> bool:
        return False

    def open(self, mode: str = "rb") -> BinaryIO:
        return io.BufferedReader(_Joined(self._path, self._length))


class _Joined(io.RawIOBase):
    """The first bytes of a file, followed by the footer."""

    def __init__(self, path: Path, length: int) -> None:
        self._file, self._length, self._position = path.open("rb"), length, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        starts = {io.SEEK_CUR: self._position, io.SEEK_END: self._length + len(_FOOTER)}
        self._position = max(0, starts.get(whence, 0) + offset)
        return self._position

    def tell(self) -> int:
        return self._position

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        rest = self._length - self._position
        if rest > 0:
            self._file.seek(self._position)
            data = self._file.read(min(rest, len(buffer)))
        else:
            data = _FOOTER[-rest:][: len(buffer)]
        buffer[: len(data)] = data
        self._position += len(data)
        return len(data)

    def close(self) -> None:
        self._file.close()
        super().close()


def mcap_file(path: Path) -> Any:
    """A file for rosbags' reader: the path, or what can be read of an MCAP file without its end."""
    if path.suffix != ".mcap":
        return path
    with path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        file.seek(max(0, size - len(_MAGIC)))
        has_end = size > len(_MAGIC) and file.read() == _MAGIC
        file.seek(0)
        if has_end or file.read(len(_MAGIC)) != _MAGIC:
            return path
        return _CutOffFile(path, _end_of_records(file, size))


def _end_of_records(file: BinaryIO, size: int) -> int:
    """Position after the last complete record."""
    position = len(_MAGIC)
    while position + _HEAD_BYTES <= size:
        file.seek(position)
        kind, length = struct.unpack("<BQ", file.read(_HEAD_BYTES))
        if kind in _END_KINDS or position + _HEAD_BYTES + length > size:
            break
        position += _HEAD_BYTES + length
    return position
