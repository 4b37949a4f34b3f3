"""The map of the stems that a run has followed."""

from __future__ import annotations

from typing import Any, Final

from edgetree.live.results import LiveResult
from edgetree.live.sinks.map_origin import MapOrigin
from edgetree.live.sinks.records import TRACK_QUANTITIES, track_record
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure.estimates import split_unit

__all__ = ["ATTRIBUTES", "StemMap"]


def _types() -> dict[str, str]:
    types = {"track": "INTEGER", "x_m": "REAL", "y_m": "REAL", "z_m": "REAL"}
    types |= dict.fromkeys(("x_std_m", "y_std_m", "z_std_m"), "REAL")
    for quantity in TRACK_QUANTITIES:
        name, unit = split_unit(quantity)
        types |= dict.fromkeys(
            (quantity, *(f"{name}_{what}_{unit}" for what in ("std", "low95", "high95"))), "REAL"
        )
        types[f"{name}_failure"] = "TEXT"
    counts = dict.fromkeys(("frames", "views"), "INTEGER")
    return {**types, **counts, "arc_deg": "REAL", "last_seen_s": "REAL", "warnings": "TEXT"}


ATTRIBUTES: Final = _types()
"""The attributes of a stem in a map, with their types in SQL."""


class StemMap:
    """Keeps the last state of each confirmed stem, also after it is not followed any more.

    Args:
        origin: where the map's origin is; None for local metres.
    """

    def __init__(self, origin: MapOrigin | None) -> None:
        self.origin = origin
        self._stems: dict[int, TreeTrack] = {}

    def update(self, result: LiveResult) -> None:
        """Take the stems of one result."""
        self._stems |= {
            track.number: track for track in result.tracks if track.state == "confirmed"
        }

    def stems(self) -> list[tuple[tuple[float, float, float], dict[str, Any]]]:
        """Coordinates and attributes of each stem, by number.

        The coordinates are x, y, z in metres, or longitude, latitude in degrees and height in
        metres if there is an origin.
        """
        return [self._stem(self._stems[number]) for number in sorted(self._stems)]

    def _stem(self, track: TreeTrack) -> tuple[tuple[float, float, float], dict[str, Any]]:
        record = track_record(track)
        for what in ("", "_std"):
            values = record[f"position{what}_m"]
            record |= zip((f"{axis}{what}_m" for axis in "xyz"), values, strict=True)
        record["warnings"] = "; ".join(track.warnings)
        x, y, z = (float(value) for value in track.position_m.xyz_m)
        place = (x, y, z) if self.origin is None else self.origin.geodetic(track.position_m.xyz_m)
        return place, {name: record.get(name) for name in ATTRIBUTES}
