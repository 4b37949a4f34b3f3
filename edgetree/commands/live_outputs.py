"""The options of `edgetree live` for outputs."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from edgetree.commands.options import check_report

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult
    from edgetree.sinks import MapOrigin, Sink

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


_Report: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.html",
        help="Report to write at the end: one HTML page with an entry for each stem, with what all"
        " views say and the picture of the best one.",
    ),
]
_Frames: TypeAlias = Annotated[int | None, typer.Option(min=1, help="End after this many results.")]


@dataclass(frozen=True)
class LiveOutputs:
    """The options for outputs."""

    jsonl: _JsonLines = None
    csv: _CsvFile = None
    map: _Map = None
    map_origin: _MapOrigin = None
    report: _Report = None
    bag: _Bag = None
    udp: _Udp = None
    mqtt: _Mqtt = None
    frames: _Frames = None

    @property
    def paths(self) -> dict[str, Path | None]:
        """The files and folders by option."""
        names = ("jsonl", "csv", "map", "report", "bag")
        return {f"--{name}": getattr(self, name) for name in names}

    def origin(self) -> MapOrigin | None:
        """The place of the map; None for local metres.

        Raises:
            InputError: options contradict each other, or a value is wrong.
        """
        from basetree.errors import InputError

        check_report(self.report)
        if self.map_origin is None:
            return None
        if self.map is None:
            raise InputError("--map-origin given without --map: expected both")
        return _origin(self.map_origin)

    def open(
        self, stack: ExitStack, to_stdout: bool, source: str, model: str
    ) -> list[Sink[LiveResult]]:
        """Open the outputs.

        Args:
            stack: closes them.
            to_stdout: whether JSON lines go to stdout.
            source: value of SOURCE, for the report.
            model: name of the model file, likewise.

        Raises:
            InputError: a file cannot be written, or an address or name cannot be used.
            MissingPackage: the package for MQTT or for bags is not installed.
        """
        from edgetree import sinks

        opened: list[Sink[LiveResult]] = []

        def add(sink: Sink[LiveResult]) -> None:
            stack.callback(sink.close)
            opened.append(sink)

        if to_stdout:
            add(sinks.JsonLinesSink(sys.stdout))
        if self.jsonl is not None:
            add(sinks.JsonLinesSink(self.jsonl))
        if self.csv is not None:
            add(sinks.CsvTracksSink(self.csv))
        if self.map is not None:
            add(sinks.open_map(self.map, self.origin()))
        if self.report is not None:
            add(sinks.StemReportSink(self.report, source, model))
        if self.bag is not None:
            add(sinks.BagSink(self.bag))
        if self.udp is not None:
            add(sinks.UdpSink(self.udp))
        if self.mqtt is not None:
            add(sinks.MqttSink(self.mqtt))
        return opened


def _origin(text: str) -> MapOrigin:
    """The place of the map.

    Raises:
        InputError: it has another form, or is out of range.
    """
    from basetree.errors import InputError
    from edgetree.sinks import MapOrigin

    try:
        latitude, longitude, *rest = (float(part) for part in text.split(","))
        return MapOrigin(latitude, longitude, *rest)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"--map-origin is {text!r}: expected LAT,LON[,HEIGHT[,HEADING]], such as 60.5,24.3"
        ) from error
