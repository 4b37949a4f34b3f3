"""The map of stems as GeoJSON."""

from __future__ import annotations

import json
from typing import Any, Final

from edgetree.live.sinks.map_file import MapFileSink

__all__ = ["GeoJsonSink"]

_SCHEMA: Final = "edgetree.live.map/1"
# 1e-8 degrees are about 1 mm.
_DIGITS: Final = {"local metres": 4, "WGS 84": 8}


class GeoJsonSink(MapFileSink):
    """Writes a map of all confirmed stems when it is closed.

    Args:
        path: the file to write.
        origin: where the map's origin is on the earth; None for local metres, which other programs
            must be told, because GeoJSON knows only WGS 84.

    Raises:
        InputError: the file cannot be written.
    """

    def _content(self) -> bytes:
        return (json.dumps(self._collection(), allow_nan=False) + "\n").encode("ascii")

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
