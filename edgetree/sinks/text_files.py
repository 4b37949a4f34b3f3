"""JSON lines and CSV tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

from basetree.errors import one_line
from basetree.files.growing import GrowingFile
from edgetree.results.csv_style import PLAIN, CsvStyle
from edgetree.results.csv_table import TRACKS, Table
from edgetree.results.json_records import live_record, write_json_line
from edgetree.results.service_state import ServiceState
from edgetree.sinks.sink import FileSink


class JsonLinesSink(FileSink[Any]):
    """Writes each result as one line.

    Args:
        target: The file to write; or an open text stream, such as standard output, which stays
            open and is flushed after each line.
        record: Makes the JSON object of a result, such as `frame_record`; by default one of the
            schema `edgetree.live/1`.
        grows: Whether the file has every line at once, and an older one is kept beside it;
            otherwise it appears whole.
        states: Whether each state of the service is a line too.

    Raises:
        InputError: The file cannot be written.
    """

    def __init__(
        self,
        target: Path | str | TextIO,
        record: Callable[[Any], dict[str, Any]] = live_record,
        *,
        grows: bool = True,
        states: bool = False,
    ) -> None:
        super().__init__()
        self._states, self._told = states, ServiceState("starting")
        self._stream, self._record = self._text(target, grows=grows), record
        self.goes_on = grows and isinstance(target, Path | str)
        self.appears_whole = not grows and isinstance(target, Path | str)

    def write(self, result: Any) -> None:
        """Write one line."""
        write_json_line(self._stream, self._record(result))

    def tell(self, state: ServiceState) -> None:
        """Write a line for a state that is new."""
        if self._states and state is not self._told:
            write_json_line(self._stream, state.record())
            self._told = state


class LinesSink(FileSink[Any]):
    """Writes each result as one short line of text, for people.

    Args:
        stream: An open text stream, such as standard output, which stays open and is flushed after
            each line.
        line: Makes the line of a result, such as `edgetree.results.frame_line.frame_line`.
    """

    appears_whole = False

    def __init__(self, stream: TextIO, line: Callable[[Any], str]) -> None:
        super().__init__()
        self._stream, self._line = stream, line

    def write(self, result: Any) -> None:
        """Write one line."""
        self._stream.write(one_line(self._line(result)) + "\n")
        self._stream.flush()


class CsvSink(FileSink[Any]):
    """Writes the rows of each result.

    Args:
        path: The file to write.
        table: The table, such as `edgetree.results.csv_table.TREES`.
        style: How it is written.
        grows: Whether the file has every row at once, and an older one is kept beside it;
            otherwise it appears whole.

    Raises:
        InputError: The file cannot be written.
    """

    def __init__(
        self, path: Path | str, table: Table[Any], style: CsvStyle = PLAIN, *, grows: bool = False
    ) -> None:
        super().__init__()
        self._stream, self._table, self._style = self._text(path, grows=grows), table, style
        self.goes_on, self.appears_whole = grows, not grows
        self._has_header = False

    def write(self, result: Any) -> None:
        """Write the rows of one frame. A file that a log rotation emptied begins anew."""
        is_empty = isinstance(self._stream, GrowingFile) and self._stream.is_empty
        if is_empty or not self._has_header:
            self._table.write_header(self._stream, self._style)
        self._table.write_rows(self._stream, result, self._style)
        self._has_header = True


class CsvTracksSink(CsvSink):
    """Writes a row for each stem that is followed, seen in the frame or not.

    Args:
        path: The file to write, which has every frame at once.
        style: How it is written.

    Raises:
        InputError: The file cannot be written.
    """

    def __init__(self, path: Path | str, style: CsvStyle = PLAIN) -> None:
        super().__init__(path, TRACKS, style, grows=True)
