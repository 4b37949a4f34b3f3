"""The map of stems as GeoJSON."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from edgetree.live.results import LiveResult
from edgetree.live.sinks.map_origin import MapOrigin
from edgetree.live.sinks.stem_map import StemMap
from edgetree.results.atomic_files import text_file

__all__ = ["GeoJsonSink"]

_SCHEMA: Final = "edgetree.live.map/1"
# 1e-8 degrees are about 1 mm.
_DIGITS: Final = {"local metres": 4, "WGS 84": 8}


class GeoJsonSink:
    """Writes a map of all confirmed stems when it is closed.

    Args:
        path: the file to write.
        origin: where the map's origin is on the earth; None for local metres, which other programs
            must be told, because GeoJSON knows only WGS 84.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(self, path: Path, origin: MapOrigin | None = None) -> None:
        self._files = ExitStack()
        self._stream = self._files.enter_context(text_file(path))
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
                json.dump(self._collection(), self._stream, allow_nan=False)
                self._stream.write("\n")

    def _collection(self) -> dict[str, Any]:
        kind = "local metres" if self._map.origin is None else "WGS 84"
        return {
            "type": "FeatureCollection",
            "schema": _SCHEMA,
            "coordinates": kind,
            "features": [
                {
                    "type": "Feature",
                    "id": attributes["track"],
                    "geometry": {
                        "type": "Point",
                        "coordinates": [
                            *(round(value, _DIGITS[kind]) for value in place[:2]),
                            round(place[2], 3),
                        ],
                    },
                    "properties": attributes,
                }
                for place, attributes in self._map.stems()
            ],
        }
