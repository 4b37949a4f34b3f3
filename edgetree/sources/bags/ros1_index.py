"""Make the index of a ROS 1 bag that was not closed, as `rosbag reindex` does.

The format is described at https://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO, Final, NamedTuple

from edgetree.sources.bags.bounded import Budget

ROS1_MAGIC: Final = b"#ROSBAG V2.0\n"
_BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 3, 4, 5, 6, 7  # kinds of records
_MAX_HEADER_BYTES: Final = 2**16
_ENTRY: Final = struct.Struct("<III")  # seconds, nanoseconds, and offset in the chunk

Header = dict[bytes, bytes]


class Index(NamedTuple):
    """What a bag lacks.

    Attributes:
        head: The first bytes of the bag, with the position of the index.
        length: Number of bytes of the file that are used.
        tail: The index.
    """

    head: bytes
    length: int
    tail: bytes


class _Record(NamedTuple):
    start: int
    header: Header
    data_start: int
    end: int

    @property
    def kind(self) -> int:
        return self.header.get(b"op", b"\0")[0]


@dataclass
class _Chunk:
    record: _Record
    end: int
    counts: dict[int, int] = field(default_factory=dict)
    first: tuple[int, int] = (2**32 - 1, 0)
    last: tuple[int, int] = (0, 0)


def missing_index(file: BinaryIO, size: int) -> Index | None:
    """The index of a bag that has none, or not all of it; None for a complete bag.

    Args:
        file: The bag, of version 2.0.
        size: Its length.
    """
    first = _read(file, len(ROS1_MAGIC), size)
    if first is None or first.kind != _BAG or _has_index(file, first, size):
        return None
    chunks = _chunks(file, first.end, size)
    tail, connections = _connections(file, chunks, Budget(size))
    for chunk in chunks:
        tail += _chunk_info(chunk)
    end = chunks[-1].end if chunks else first.end
    counts = {b"conn_count": struct.pack("<I", connections)}
    counts |= {b"chunk_count": struct.pack("<I", len(chunks)), b"index_pos": struct.pack("<Q", end)}
    return Index(ROS1_MAGIC + _record(first.header | counts, _rest(first)), end, tail)


def _has_index(file: BinaryIO, first: _Record, size: int) -> bool:
    """Whether all records of the index are there."""
    try:
        (position,) = struct.unpack("<Q", first.header[b"index_pos"])
        (connections,) = struct.unpack("<I", first.header[b"conn_count"])
        (chunks,) = struct.unpack("<I", first.header[b"chunk_count"])
    except (KeyError, struct.error):
        return True  # no bag that can be mended
    expected = connections + chunks
    kinds = [record.kind for record in _records(file, position, size)] if position else []
    return len(kinds) >= expected and bool(position) and {*kinds} <= {_CONNECTION, _CHUNK_INFO}


def _records(file: BinaryIO, position: int, size: int) -> Iterator[_Record]:
    while (record := _read(file, position, size)) is not None:
        yield record
        position = record.end


def _read(file: BinaryIO, start: int, size: int) -> _Record | None:
    """The record at a position; None if it is not complete."""
    file.seek(start)
    try:
        (length,) = struct.unpack("<I", file.read(4))
        if length > _MAX_HEADER_BYTES:
            return None
        header = _header(file.read(length))
        (data_length,) = struct.unpack("<I", file.read(4))
    except struct.error:
        return None
    data_start = start + 8 + length
    end = data_start + data_length
    return None if end > size or b"op" not in header else _Record(start, header, data_start, end)


def _header(content: bytes) -> Header:
    header: Header = {}
    position = 0
    while position + 4 <= len(content):
        (length,) = struct.unpack_from("<I", content, position)
        name, _, value = content[position + 4 : position + 4 + length].partition(b"=")
        header[name] = value
        position += 4 + length
    return header


def _chunks(file: BinaryIO, position: int, size: int) -> list[_Chunk]:
    """The chunks that are complete, with what their index records state."""
    chunks: list[_Chunk] = []
    for record in _records(file, position, size):
        if record.kind == _CHUNK:
            chunks.append(_Chunk(record, record.end))
        elif record.kind == _INDEX and chunks:
            _take_index(file, chunks[-1], record)
        else:
            break
    return [chunk for chunk in chunks if chunk.counts]


def _take_index(file: BinaryIO, chunk: _Chunk, record: _Record) -> None:
    file.seek(record.data_start)
    entries = file.read(record.end - record.data_start)
    times = [entry[:2] for entry in _ENTRY.iter_unpack(entries[: len(entries) // 12 * 12])]
    if not times:
        return
    (connection,) = struct.unpack("<I", record.header.get(b"conn", b"")[:4].ljust(4, b"\0"))
    chunk.counts[connection] = len(times)
    chunk.first, chunk.last = min(chunk.first, *times), max(chunk.last, *times)
    chunk.end = record.end


def _connections(file: BinaryIO, chunks: list[_Chunk], budget: Budget) -> tuple[bytes, int]:
    """The records of the connections, which stand in the chunks, and their number."""
    wanted = {connection for chunk in chunks for connection in chunk.counts}
    found: dict[bytes, bytes] = {}
    for chunk in chunks:
        if len(found) >= len(wanted):
            break
        file.seek(chunk.record.data_start)
        content = file.read(chunk.record.end - chunk.record.data_start)
        compression = chunk.record.header.get(b"compression", b"none").decode("ascii", "replace")
        content = budget.unpacked(content, compression)
        inner = io.BytesIO(content)
        for record in _records(inner, 0, len(content)):
            if record.kind == _CONNECTION:
                found.setdefault(record.header[b"conn"], content[record.start : record.end])
    return b"".join(found.values()), len(found)


def _chunk_info(chunk: _Chunk) -> bytes:
    data = b"".join(struct.pack("<II", *entry) for entry in chunk.counts.items())
    header = {
        b"op": bytes([_CHUNK_INFO]),
        b"ver": struct.pack("<I", 1),
        b"chunk_pos": struct.pack("<Q", chunk.record.start),
        b"start_time": struct.pack("<II", *chunk.first),
        b"end_time": struct.pack("<II", *chunk.last),
        b"count": struct.pack("<I", len(chunk.counts)),
    }
    return _record(header, data)


def _rest(record: _Record) -> bytes:
    """The padding of the first record; its length does not change with the values of its header."""
    return b" " * (record.end - record.data_start)


def _record(header: Header, data: bytes) -> bytes:
    fields = [name + b"=" + value for name, value in header.items()]
    content = b"".join(struct.pack("<I", len(text)) + text for text in fields)
    return struct.pack("<I", len(content)) + content + struct.pack("<I", len(data)) + data
