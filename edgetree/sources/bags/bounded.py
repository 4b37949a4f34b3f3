"""Unpack and read what a file states the size of, within limits."""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final

from basetree.files.limits import current_limits
from basetree.files.regular import open_regular

ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_PART_BYTES: Final = 2**20
# Recorders pack pictures and numbers to a half or a tenth. What unpacks to more than this is no
# recording, and would take for ever.
_MOST_TIMES: Final = 1000


class TooLarge(ValueError):
    """What unpacks to more than `Limits` allows."""


class Budget:
    """Bytes that may be unpacked from one file.

    Args:
        file_bytes: Size of the file.
    """

    def __init__(self, file_bytes: int) -> None:
        self.file_bytes = file_bytes
        self._left = _MOST_TIMES * file_bytes + 4 * current_limits().recording_chunk_bytes

    def unpacked(self, data: bytes, kind: str, size: int | None = None) -> bytes:
        """Unpack data.

        Args:
            data: Packed bytes.
            kind: "" or "none", "zstd", "lz4" or "bz2".
            size: How many bytes it should unpack to; None if that is not stated.

        Raises:
            ValueError: It is broken, has another size, or is larger than `Limits` allows.
        """
        largest = current_limits().recording_chunk_bytes
        if size is not None and size > largest:
            raise TooLarge(
                f"a chunk has {size} bytes, expected at most {largest}, the limit"
                " recording_chunk_bytes"
            )
        content = b"".join(_parts(data, kind, largest if size is None else size))
        if size is not None and len(content) != size:
            raise ValueError(f"a chunk has {len(content)} bytes, expected {size}")
        self.spend(len(content))
        return content

    def spend(self, size: int) -> None:
        """Count unpacked bytes.

        Raises:
            ValueError: There are more than a recording has.
        """
        self._left -= size
        if self._left < 0:
            raise TooLarge(f"it unpacks to more than {_MOST_TIMES} times its size")


def _parts(data: bytes, kind: str, most: int) -> Iterator[bytes]:
    """The unpacked bytes; ValueError if there are more than `most`."""
    total = 0
    for part in _unpacked_parts(data, kind, most):
        total += len(part)
        if total > most:
            raise TooLarge(f"a chunk has more than {most} bytes, as stated or allowed")
        yield part


def _unpacked_parts(data: bytes, kind: str, most: int) -> Iterator[bytes]:
    if kind in ("", "none"):
        yield data
    elif kind == "zstd":
        yield from zstd_parts(io.BytesIO(data))
    elif kind in ("lz4", "bz2"):
        decompressor = _decompressor(kind)
        while not decompressor.eof:
            part = decompressor.decompress(data, min(_PART_BYTES, most + 1))
            if not part and decompressor.needs_input:
                raise ValueError(f"a chunk of {kind} is cut off")
            data = b""
            yield part
    else:
        raise ValueError(f"its chunks are packed by {kind!r}, expected none, zstd, lz4 or bz2")


def _decompressor(kind: str) -> Any:
    if kind == "bz2":
        import bz2

        return bz2.BZ2Decompressor()
    import lz4.frame

    return lz4.frame.LZ4FrameDecompressor()


def zstd_parts(file: BinaryIO) -> Iterator[bytes]:
    """The content of a file of zstd, in parts of at most a mebibyte."""
    import zstandard

    # A decoder may ask for a window of gigabytes; recorders use at most 8 MiB.
    decompressor = zstandard.ZstdDecompressor(max_window_size=2**27)
    with decompressor.stream_reader(file, read_across_frames=True, closefd=False) as reader:
        while part := reader.read(_PART_BYTES):
            yield part


class BoundedFile(io.BufferedReader):
    """A file of which no more is asked than it has; `read` takes memory for what is asked.

    Attributes:
        size: Its length in bytes.
    """

    def __init__(self, raw: io.RawIOBase) -> None:
        super().__init__(raw)
        self.size = self.seek(0, io.SEEK_END)
        self.seek(0)

    def read(self, size: int | None = -1) -> bytes:
        """Read up to `size` bytes."""
        left = max(0, self.size - self.tell())
        return super().read(left if size is None or size < 0 else min(size, left))


def open_bounded(path: Path) -> BoundedFile:
    """Open a file for reading."""
    return BoundedFile(open_regular(path).detach())


def is_crc_wrong(content: bytes, crc: int) -> bool:
    """Whether a checksum is stated and does not fit."""
    return crc != 0 and zlib.crc32(content) != crc
