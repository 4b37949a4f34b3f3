"""The options of `edgetree live` for outputs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

if TYPE_CHECKING:
    from edgetree.live.sinks import MapOrigin
    from edgetree.live.sinks.opening import SinkOptions

__all__ = ["LiveOutputs"]

_JsonLines: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="File for the JSON lines, instead of stdout (with --page: nowhere)."),
]
_CsvFile: TypeAlias = Annotated[
    Path | None, typer.Option("--csv", help="CSV file to write, one row per stem and frame.")
]
_Map: TypeAlias = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Map of the stems to write at the end: .geojson or .gpkg."),
]
_Bag: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="ROS 2 bag (MCAP) of pictures, poses and stems to write, for Foxglove or Rerun.",
    ),
]
_Udp: TypeAlias = Annotated[
    str | None,
    typer.Option(metavar="HOST:PORT", help="Send a datagram with the stems for each frame."),
]
_MapOrigin: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="LAT,LON[,HEIGHT[,HEADING]]",
        help="Place of the map on Earth: degrees in WGS 84, metres, and direction of the map's y"
        " axis in degrees clockwise from north. If not given, the map is in metres.",
    ),
]
_Mqtt: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="HOST[:PORT]", help="Publish the stems of each frame at this MQTT broker."
    ),
]


@dataclass(frozen=True)
class LiveOutputs:
    """The options for outputs."""

    jsonl: _JsonLines = None
    csv: _CsvFile = None
    map: _Map = None
    map_origin: _MapOrigin = None
    bag: _Bag = None
    udp: _Udp = None
    mqtt: _Mqtt = None

    def options(self, to_stdout: bool) -> SinkOptions:
        """The outputs, with JSON lines on stdout if `to_stdout`."""
        from edgetree.live.sinks.opening import SinkOptions

        origin = None if self.map_origin is None else _origin(self.map_origin)
        return SinkOptions(
            jsonl=self.jsonl,
            csv=self.csv,
            stem_map=self.map,
            origin=origin,
            bag=self.bag,
            udp=self.udp,
            mqtt=self.mqtt,
            to_stdout=to_stdout,
        )


def _origin(text: str) -> MapOrigin:
    """The place of the map.

    Raises:
        InputError: it has another form, or is out of range.
    """
    from basetree.errors import InputError
    from edgetree.live.sinks import MapOrigin

    try:
        latitude, longitude, *rest = (float(part) for part in text.split(","))
        return MapOrigin(latitude, longitude, *rest)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"--map-origin is {text!r}: expected LAT,LON[,HEIGHT[,HEADING]], such as 60.5,24.3"
        ) from error
