"""Maps of the stems that were followed, as GeoJSON and GeoPackage."""

from __future__ import annotations

import json
import logging
import threading
from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from basetree.counts import counted
from basetree.errors import InputError
from basetree.files.growing import keep_older
from basetree.files.writing import replacing, write_whole
from edgetree.measure.estimates import interval_keys
from edgetree.results.json_records import TRACK_QUANTITIES, track_record
from edgetree.sinks.geopackage import geopackage
from edgetree.sinks.map_origin import MapOrigin
from edgetree.sinks.sink import FileSink

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult
    from edgetree.live.tracking.tracks import TreeTrack

_LOG: Final = logging.getLogger(__name__)
_SCHEMA: Final = "edgetree.live.map/1"
_SO_FAR_S: Final = 60.0
_GEOPACKAGE: Final = ".gpkg"
# 1e-8 degrees are about 1 mm.
_DIGITS: Final = {"local metres": 4, "WGS 84": 8}


def _types() -> dict[str, str]:
    places = [f"{axis}{what}_m" for what in ("", "_std") for axis in "xyz"]
    types = {"track": "INTEGER"} | dict.fromkeys(places, "REAL")
    for quantity in TRACK_QUANTITIES:
        *numbers, failure = interval_keys(quantity)
        types |= dict.fromkeys(numbers, "REAL") | {failure: "TEXT"}
    counts = dict.fromkeys(("frames", "views"), "INTEGER")
    ends = {"last_seen_s": "REAL", "map_part": "INTEGER", "warnings": "TEXT"}
    return {**types, **counts, "arc_deg": "REAL", **ends}


_ATTRIBUTES: Final = _types()
"""The attributes of a stem, with their types in SQL."""


class _MapSink(FileSink["LiveResult"]):
    """Keeps the last state of each confirmed stem, also after it is not followed any more."""

    def __init__(
        self, path: Path | str, origin: MapOrigin | None = None, *, keeps_older: bool = False
    ) -> None:
        super().__init__()
        path = Path(path)
        self._origin = origin
        self._stems: dict[int, TreeTrack] = {}
        self._parts_with_poses: set[int] = set()
        if keeps_older:
            so_far = path.with_name(f"unfinished_{path.name}")
            self._files.enter_context(self._written_so_far(so_far))
        self._files.enter_context(self._written(path, keeps_older))

    @contextmanager
    def _written(self, path: Path, keeps_older: bool) -> Iterator[None]:
        with replacing(path) as stream:
            yield
            stream.write(self._content())
            self._tell_left_out(path)
            if keeps_older:
                keep_older(path)

    @contextmanager
    def _written_so_far(self, path: Path) -> Iterator[None]:
        """Write the map so far every minute during a block, in case that the process is killed."""
        keep_older(path)
        is_over = threading.Event()

        def write() -> None:
            while not is_over.wait(_SO_FAR_S):
                with suppress(InputError):  # the map itself is still to come
                    write_whole(path, self._content())

        writer = threading.Thread(target=write, name="edgetree-map", daemon=True)
        writer.start()
        try:
            yield
        finally:
            is_over.set()
            writer.join()
        path.unlink(missing_ok=True)

    def write(self, result: LiveResult) -> None:
        """Take the stems of one result."""
        confirmed = {track.number: track for track in result.tracks if track.state == "confirmed"}
        absorbed = {number for track in confirmed.values() for number in track.absorbed}
        stems = {**self._stems, **confirmed}
        # A new one, as the other may be written just now.
        self._stems = {number: each for number, each in stems.items() if number not in absorbed}
        if result.frame.pose is not None:
            self._parts_with_poses.update(track.map_part for track in confirmed.values())

    def _placed(self) -> dict[int, TreeTrack]:
        """The stems whose place in the file's coordinates is known."""
        if self._origin is None:
            return self._stems
        parts = self._parts_with_poses or {1}
        return {number: each for number, each in self._stems.items() if each.map_part in parts}

    def _tell_left_out(self, path: Path) -> None:
        count = len(self._stems) - len(self._placed())
        if count:
            _LOG.warning(
                "map %s: %s of other maps left out, as nothing tells where on the earth they are",
                *(path, counted(count, "stem")),
            )

    @abstractmethod
    def _content(self) -> bytes:
        """The content of the file."""

    def _all(self) -> list[tuple[tuple[float, float, float], dict[str, Any]]]:
        """Coordinates and attributes of each stem, by number.

        The coordinates are x, y, z in metres, or longitude, latitude in degrees and height in
        metres if there is an origin.
        """
        return [self._one(track) for _, track in sorted(self._placed().items())]

    def _one(self, track: TreeTrack) -> tuple[tuple[float, float, float], dict[str, Any]]:
        record = track_record(track)
        for what in ("", "_std"):
            values = record[f"position{what}_m"]
            record |= zip((f"{axis}{what}_m" for axis in "xyz"), values, strict=True)
        record["warnings"] = "; ".join(track.warnings)
        x, y, z = (float(value) for value in track.position_m.xyz_m)
        place = (x, y, z) if self._origin is None else self._origin.geodetic(track.position_m.xyz_m)
        return place, {name: record.get(name) for name in _ATTRIBUTES}


class GeoJsonSink(_MapSink):
    """Writes a map of all confirmed stems when it is closed.

    Args:
        path: The file to write.
        origin: Where the map's origin is on the earth; None for local metres, which other programs
            must be told, because GeoJSON knows only WGS 84.
        keeps_older: Whether a file at the path is kept, see `basetree.files.growing.keep_older`,
            and the map so far is written to `unfinished_NAME` every minute.

    Raises:
        InputError: The file cannot be written.
    """

    def _content(self) -> bytes:
        return (json.dumps(self._collection(), allow_nan=False) + "\n").encode("ascii")

    def _collection(self) -> dict[str, Any]:
        kind = "local metres" if self._origin is None else "WGS 84"
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
                for place, attributes in self._all()
            ],
        }


class GeoPackageSink(_MapSink):
    """Writes a map of all confirmed stems when it is closed, as the table `stems`.

    Args:
        path: The file to write.
        origin: Where the map's origin is on the earth; None for local metres, an undefined
            Cartesian reference system.
        keeps_older: Whether a file at the path is kept, see `basetree.files.growing.keep_older`,
            and the map so far is written to `unfinished_NAME` every minute.

    Raises:
        InputError: The file cannot be written.
    """

    def _content(self) -> bytes:
        return geopackage(self._all(), _ATTRIBUTES, is_local=self._origin is None)


def open_map(
    path: Path | str, origin: MapOrigin | None = None, *, keeps_older: bool = False
) -> GeoJsonSink | GeoPackageSink:
    """Open a map by the suffix of its name: .geojson, .json or .gpkg.

    Raises:
        InputError: The name has another suffix, or the file cannot be written.
    """
    path = Path(path)
    check_map_name(path)
    if path.suffix.lower() == _GEOPACKAGE:
        return GeoPackageSink(path, origin, keeps_older=keeps_older)
    return GeoJsonSink(path, origin, keeps_older=keeps_older)


def check_map_name(path: Path) -> None:
    """Raise InputError if a name has no suffix of a map."""
    if path.suffix.lower() not in (".geojson", ".json", _GEOPACKAGE):
        raise InputError(f"the map (--map) is {path}: expected a name in .geojson or .gpkg")
