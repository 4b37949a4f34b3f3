"""JSON lines: one object of the schema `edgetree.live/1` for each frame."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

from edgetree.live.results import LiveResult
from edgetree.live.sinks.growing_file import growing_file
from edgetree.live.sinks.records import live_record
from edgetree.results.json_records import write_json_line

__all__ = ["JsonLinesSink"]


class JsonLinesSink:
    """Writes each result as one line.

    Args:
        target: the file to write, which has every frame at once; or an open text stream,
            such as standard output, which stays open and is flushed after each line.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(self, target: Path | TextIO) -> None:
        self._files = ExitStack()
        if isinstance(target, Path):
            target = self._files.enter_context(growing_file(target))
        self._stream = target

    def write(self, result: LiveResult) -> None:
        """Write one line."""
        write_json_line(self._stream, live_record(result))

    def close(self) -> None:
        """Complete the file."""
        self._files.close()
