"""What files with a map of the stems have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import ExitStack
from pathlib import Path

from basetree.files.writing import replacing
from edgetree.live.results import LiveResult
from edgetree.live.sinks.map_origin import MapOrigin
from edgetree.live.sinks.stem_map import StemMap

__all__ = ["MapFileSink"]


class MapFileSink(ABC):
    """Collects all confirmed stems, and writes them when it is closed.

    Args:
        path: the file to write.
        origin: where the map's origin is on the earth; None for local metres.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(self, path: Path, origin: MapOrigin | None = None) -> None:
        self._files = ExitStack()
        self._stream = self._files.enter_context(replacing(path))
        self._map = StemMap(origin)
        self._done = False

    def write(self, result: LiveResult) -> None:
        """Take the stems of one result."""
        self._map.update(result)

    def close(self) -> None:
        """Write the map."""
        if not self._done:
            self._done = True
            with self._files:
                self._stream.write(self._content())

    @abstractmethod
    def _content(self) -> bytes:
        """The content of the file."""
