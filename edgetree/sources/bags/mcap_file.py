"""MCAP files of any profile, complete or without their end.

The format is described at https://mcap.dev/spec. The records are parsed by the package mcap; it
unpacks chunks of any size, and so this module unpacks them itself, within limits.
"""

from __future__ import annotations

import heapq
import io
import struct
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from basetree.files.limits import current_limits
from edgetree.sources.bags.bounded import Budget, TooLarge, is_crc_wrong, open_bounded
from edgetree.sources.bags.names import MCAP_MAGIC
from edgetree.sources.bags.storage import Channel, Stored, normal_type

_HEAD: Final = struct.Struct("<BQ")  # of a record: its kind and the length of its content
_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_FOOTER_BYTES: Final = _HEAD.size + 20
_END_KINDS: Final = (0, Opcode.FOOTER, Opcode.DATA_END)


class _Record(NamedTuple):
    kind: int
    start: int
    end: int


class _Chunk(NamedTuple):
    start_ns: int
    position: int
    channels: Collection[int]


class McapFile:
    """An open MCAP file, as `Storage`.

    Args:
        path: The file.

    Raises:
        ValueError: It is broken. The package mcap has errors of its own.
    """

    def __init__(self, path: Path) -> None:
        self.channels: list[Channel] = []
        self._file = open_bounded(path)
        try:
            self._open()
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> None:
        self._budget = Budget(self._file.size)
        self._schemas: dict[int, Any] = {}
        self._by_id: dict[int, Channel] = {}
        self._chunks: dict[int, _Chunk] = {}
        self.start_ns, self.end_ns = 2**63 - 1, 0
        if self._file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
            raise ValueError("its first bytes are not those of MCAP")
        self._file.seek(max(0, self._file.size - len(MCAP_MAGIC)))
        self.is_cut_off = self._file.read() != MCAP_MAGIC or self._file.size < 2 * len(MCAP_MAGIC)
        if self.is_cut_off or not self._read_summary():
            self._scan()
        self.channels = list(self._by_id.values())

    def _read_summary(self) -> bool:
        """Read channels, counts and chunks from the end; False if they are not there."""
        footer = self._file.size - len(MCAP_MAGIC) - _FOOTER_BYTES
        self._file.seek(footer)
        kind, length = _HEAD.unpack(self._file.read(_HEAD.size))
        if (kind, length) != (Opcode.FOOTER, 20):
            raise ValueError("its footer is broken")
        (start,) = struct.unpack("<Q", self._file.read(8))
        if not len(MCAP_MAGIC) <= start < footer:
            return False
        counts = None
        for record in self._records(start, footer):
            if record.kind == Opcode.STATISTICS:
                counts = self._parsed(record, records.Statistics.read)
            elif record.kind == Opcode.CHUNK_INDEX:
                self._take_chunk(self._parsed(record, records.ChunkIndex.read))
            else:
                self._take_definition(record.kind, self._content(record))
        if counts is None or not self._by_id or not (self._chunks or not counts.chunk_count):
            self._by_id, self._chunks = {}, {}
            return False
        for number, channel in self._by_id.items():
            channel.count = counts.channel_message_counts.get(number, 0)
        self.start_ns, self.end_ns = counts.message_start_time, counts.message_end_time
        return True

    def _take_chunk(self, index: Any) -> None:
        position = index.chunk_start_offset
        self._chunks[position] = _Chunk(
            index.message_start_time, position, index.message_index_offsets.keys()
        )

    def _take_definition(self, kind: int, content: bytes) -> None:
        """Take a schema or a channel."""
        if kind == Opcode.SCHEMA:
            schema = records.Schema.read(ReadDataStream(io.BytesIO(content)))
            self._schemas[schema.id] = schema
        elif kind == Opcode.CHANNEL:
            channel = records.Channel.read(ReadDataStream(io.BytesIO(content)))
            schema = self._schemas.get(channel.schema_id)
            name, data = ("", b"") if schema is None else (schema.name, schema.data)
            encoding = channel.message_encoding
            kind_name = normal_type(name) if encoding == "ros1" else name
            self._by_id.setdefault(
                channel.id, Channel(channel.topic, kind_name, encoding, schema=data)
            )

    def _scan(self) -> None:
        """Read all channels and count their messages."""
        for kind, content in self._contents():
            if kind == Opcode.MESSAGE:
                number, _, log_ns, _ = _MESSAGE.unpack_from(content)
                if number in self._by_id:
                    self._by_id[number].count += 1
                    self.start_ns = min(self.start_ns, log_ns)
                    self.end_ns = max(self.end_ns, log_ns)
            else:
                self._take_definition(kind, content)

    def messages(self, channels: Collection[Channel]) -> Iterator[Stored]:
        """Yield the messages of channels, in the order of time if the file has an index.

        Raises:
            ValueError: The file is broken.
        """
        wanted = {n: each for n, each in self._by_id.items() if each in channels}
        self._budget = Budget(self._file.size)
        if self._chunks:
            yield from self._by_time(wanted)
            return
        for kind, content in self._contents():
            if kind == Opcode.MESSAGE:
                number, _, log_ns, _ = _MESSAGE.unpack_from(content)
                if number in wanted:
                    yield Stored(wanted[number], log_ns, content[_MESSAGE.size :])

    def _by_time(self, wanted: dict[int, Channel]) -> Iterator[Stored]:
        """Messages by time: those of a chunk wait until no later chunk can begin before them."""
        waiting: list[tuple[int, int, Channel, bytes]] = []
        most, held, serial = current_limits().recording_chunk_bytes, 0, 0
        for chunk in sorted(self._chunks.values()):
            # Where chunks overlap in time by more than memory should hold, order gives way.
            while waiting and (waiting[0][0] < chunk.start_ns or held > most):
                log_ns, _, channel, data = heapq.heappop(waiting)
                held -= len(data)
                yield Stored(channel, log_ns, data)
            if chunk.channels and not any(number in wanted for number in chunk.channels):
                continue
            for kind, content in self._chunk(self._record(chunk.position, self._file.size)):
                if kind != Opcode.MESSAGE:
                    continue
                number, _, log_ns, _ = _MESSAGE.unpack_from(content)
                if number in wanted:
                    data = content[_MESSAGE.size :]
                    heapq.heappush(waiting, (log_ns, serial, wanted[number], data))
                    held += len(data)
                    serial += 1
        while waiting:
            log_ns, _, channel, data = heapq.heappop(waiting)
            yield Stored(channel, log_ns, data)

    def _contents(self) -> Iterator[tuple[int, bytes]]:
        """Kind and content of the records in the order of the file, those in chunks included.

        A file without its end is read up to a chunk that is broken: a disk may know the length of
        a file and not have written all of it when the power fails.
        """
        is_first = True
        for record in self._records(len(MCAP_MAGIC), self._file.size):
            if record.kind in _END_KINDS:
                return
            if record.kind == Opcode.CHUNK:
                try:
                    yield from self._chunk(record)
                except TooLarge:
                    raise
                except Exception:  # of many kinds, by how the chunk is packed
                    if self.is_cut_off and not is_first:
                        return
                    raise
                is_first = False
            elif record.kind in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                yield record.kind, self._content(record)

    def _records(self, position: int, end: int) -> Iterator[_Record]:
        """The records between two positions; of a file without its end, those that are complete."""
        while position + _HEAD.size <= end:
            try:
                record = self._record(position, end)
            except ValueError:
                if self.is_cut_off:
                    return
                raise
            yield record
            position = record.end

    def _record(self, position: int, end: int) -> _Record:
        if position + _HEAD.size > end:
            raise ValueError(f"no record is at byte {position}")
        self._file.seek(position)
        kind, length = _HEAD.unpack(self._file.read(_HEAD.size))
        start = position + _HEAD.size
        if length > end - start:
            raise ValueError(f"a record at byte {position} has {length} bytes, more than there are")
        return _Record(kind, start, start + length)

    def _content(self, record: _Record) -> bytes:
        self._file.seek(record.start)
        return self._file.read(record.end - record.start)

    def _parsed(self, record: _Record, read: Callable[[ReadDataStream], Any]) -> Any:
        return read(ReadDataStream(io.BytesIO(self._content(record))))

    def _chunk(self, record: _Record) -> Iterator[tuple[int, bytes]]:
        """Kind and content of the records in a chunk."""
        if record.kind != Opcode.CHUNK:
            raise ValueError(f"at byte {record.start} is no chunk, as the index says")
        packed = self._parsed(record, records.Chunk.read)
        content = self._budget.unpacked(packed.data, packed.compression, packed.uncompressed_size)
        if is_crc_wrong(content, packed.uncompressed_crc):
            raise ValueError("the checksum of a chunk is wrong")
        position = 0
        while position + _HEAD.size <= len(content):
            kind, length = _HEAD.unpack_from(content, position)
            start = position + _HEAD.size
            position = start + length
            if position > len(content):
                raise ValueError(f"a record in a chunk has {length} bytes, more than there are")
            yield kind, content[start:position]

    def close(self) -> None:
        """Close the file."""
        self._file.close()
