"""Databases of ROS 2 bags (.db3), with what a crash has left in their logs."""

from __future__ import annotations

import logging
import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from basetree.files.limits import current_limits
from edgetree.sources.bags.storage import Channel, Stored

_log = logging.getLogger(__name__)

_LOGS: Final = ("-wal", "-journal")
_PRIMARY: Final = 0xFF
"""The bits of an error code that tell the kind of the error."""
_TEXTS: Final = {"name": 1, "type": 2, "serialization_format": 3}


class SqliteFile:
    """An open database, as `Storage`.

    A database beside which a log with content lies was not closed. It is copied with its log to a
    temporary folder, where SQLite takes over what the log has; the user's files stay as they are.
    Of a file that lacks its end, the messages before the first page that cannot be read are given,
    in the order in which they were recorded.

    Args:
        path: The file.

    Raises:
        ValueError: It is no database of a ROS 2 bag. The package sqlite3 has errors of its own.
    """

    def __init__(self, path: Path) -> None:
        logs = [log for log in (Path(f"{path}{end}") for end in _LOGS) if _has_content(log)]
        self.is_cut_off = False  # the log has what the database lacks
        self._folder = None
        if logs:
            _log.info("%s was not closed: it is read with %s", path, logs[0].name)
            self._folder = tempfile.TemporaryDirectory(prefix="edgetree-")
            for file in (path, *logs):
                shutil.copyfile(file, Path(self._folder.name, file.name))
            path = Path(self._folder.name, path.name)
        how = "mode=rw" if logs else "mode=ro&immutable=1"
        try:
            address = f"file:{quote(str(path.absolute()))}?{how}"
            self._database = sqlite3.connect(address, uri=True, check_same_thread=False)
            try:
                self._open()
            except BaseException:
                self._database.close()
                raise
        except BaseException:
            self._remove_copy()
            raise

    def _open(self) -> None:
        most = min(current_limits().recording_chunk_bytes, 2**31 - 1)
        self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, most)
        self._database.execute("PRAGMA trusted_schema = OFF")
        # Without this SQLite opens no file that lacks pages. Nothing is written.
        self._database.execute("PRAGMA writable_schema = ON")
        for table in ("messages", "topics"):
            self._check_table(table)
        counts = self._count()
        self._by_id: dict[int, Channel] = {}
        rows = self._database.execute("SELECT id, name, type, serialization_format FROM topics")
        for row in rows:
            for column, index in _TEXTS.items():
                if not isinstance(row[index], str):
                    raise ValueError(f"a {column} in its table topics is no text")
            self._by_id[row[0]] = Channel(row[1], row[2], row[3], counts.get(row[0], 0))
        self.channels = list(self._by_id.values())

    def _count(self) -> Counter[Any]:
        """Count the messages of each topic, and set the first and the last time."""
        counts: Counter[Any] = Counter()
        self.start_ns, self.end_ns = 2**63 - 1, 0
        # Not by its index on time: rows come in the order of the table's pages.
        query = "SELECT topic_id, timestamp FROM messages NOT INDEXED ORDER BY rowid"
        with closing(self._database.execute(query)) as rows:
            try:
                for topic, log_ns in rows:
                    counts[topic] += 1
                    if isinstance(log_ns, int):
                        self.start_ns = min(self.start_ns, log_ns)
                        self.end_ns = max(self.end_ns, log_ns)
            except sqlite3.DatabaseError as error:
                if error.sqlite_errorcode & _PRIMARY != sqlite3.SQLITE_CORRUPT:
                    raise
                self.is_cut_off = True
        return counts

    def _check_table(self, name: str) -> None:
        """Refuse views, virtual tables and columns that are computed: they can be of any size."""
        row = self._database.execute(
            "SELECT rootpage FROM sqlite_master WHERE type='table' AND name=?", (name,)
        ).fetchone()
        if row is None or not row[0]:
            raise ValueError(f"it has no table {name}")
        columns = self._database.execute(f"PRAGMA table_xinfo({name})").fetchall()
        if any(column[6] for column in columns):
            raise ValueError(f"its table {name} has computed columns")

    def messages(self, channels: Collection[Channel]) -> Iterator[Stored]:
        """Yield the messages of channels in the order of time.

        Raises:
            ValueError: A time stamp is no whole number.
        """
        wanted = [number for number, channel in self._by_id.items() if channel in channels]
        places = ",".join("?" * len(wanted))
        order = "rowid" if self.is_cut_off else "timestamp"
        query = (
            f"SELECT topic_id, timestamp, data FROM messages {'NOT INDEXED' * self.is_cut_off}"
            f" WHERE topic_id IN ({places}) ORDER BY {order}"
        )
        with closing(self._database.execute(query, wanted)) as rows:
            try:
                for number, log_ns, data in rows:
                    if not isinstance(log_ns, int):
                        raise ValueError("a timestamp in its table messages is no whole number")
                    # What is no blob cannot be decoded, and is counted so.
                    blob = data if isinstance(data, bytes) else b""
                    yield Stored(self._by_id[number], log_ns, blob)
            except sqlite3.DatabaseError:
                if not self.is_cut_off:
                    raise

    def close(self) -> None:
        """Close the database."""
        self._database.close()
        self._remove_copy()

    def _remove_copy(self) -> None:
        if self._folder is not None:
            self._folder.cleanup()


def _has_content(path: Path) -> bool:
    return path.is_file() and path.stat().st_size > 0
