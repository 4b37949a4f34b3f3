"""ROS 1 bags, by rosbags' reader, within limits."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import decompressors

from edgetree.sources.bags.bounded import Budget
from edgetree.sources.bags.cut_off import BagPath
from edgetree.sources.bags.storage import Channel, Stored


class _BoundedReader(Reader):
    """Reads no chunk twice at the opening, and unpacks chunks within limits."""

    def __init__(self, path: BagPath) -> None:
        super().__init__(path)  # type: ignore[arg-type]
        self._size = path.size
        self.budget = Budget(self._size)
        self._positions: set[int] = set()
        self._index_bytes = 0

    def read_chunk_info(self) -> Any:
        info = super().read_chunk_info()
        if info.pos in self._positions:
            raise ValueError("a chunk is twice in its index")
        self._positions.add(info.pos)
        return info

    def read_chunk(self) -> Any:
        chunk = super().read_chunk()
        kind = next(name for name, each in decompressors.items() if each is chunk.decompressor)
        return chunk._replace(decompressor=partial(self._unpacked, kind))

    def _unpacked(self, kind: str, data: bytes) -> bytes:
        return self.budget.unpacked(data, kind)

    def read_index_data(self, pos: int, indexes: Any) -> None:
        assert self.bio is not None
        before = self.bio.tell()
        super().read_index_data(pos, indexes)
        self._index_bytes += self.bio.tell() - before
        if self._index_bytes > self._size:
            raise ValueError("its index is larger than the file")


class Ros1File:
    """An open ROS 1 bag, as `Storage`.

    Args:
        path: The file.

    Raises:
        Exception: It is broken; rosbags has errors of many kinds.
    """

    def __init__(self, path: Path) -> None:
        source = BagPath.of(path)
        self.is_cut_off = source.is_cut_off
        self._reader = _BoundedReader(source)
        self._reader.open()
        self.start_ns, self.end_ns = 2**63 - 1, 0
        if self._reader.connections:  # none is there if not one chunk is complete
            self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time
        self._by_connection = {
            connection.id: Channel(
                connection.topic, connection.msgtype, "ros1", connection.msgcount
            )
            for connection in self._reader.connections
        }
        self.channels = list(self._by_connection.values())

    def messages(self, channels: Collection[Channel]) -> Iterator[Stored]:
        """Yield the messages of channels in the order of time."""
        wanted = [c for c in self._reader.connections if self._by_connection[c.id] in channels]
        self._reader.budget = Budget(self._reader.budget.file_bytes)
        if wanted:  # none would be all for rosbags
            for connection, log_ns, data in self._reader.messages(wanted):
                yield Stored(self._by_connection[connection.id], log_ns, data)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()
