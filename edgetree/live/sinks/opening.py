"""Open outputs by the texts of a command line."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from basetree.errors import InputError
from edgetree.live.sinks.bag import BagSink
from edgetree.live.sinks.csv_tracks import CsvTracksSink
from edgetree.live.sinks.geojson import GeoJsonSink
from edgetree.live.sinks.geopackage import GeoPackageSink
from edgetree.live.sinks.json_lines import JsonLinesSink
from edgetree.live.sinks.map_origin import MapOrigin
from edgetree.live.sinks.mqtt import MqttSink
from edgetree.live.sinks.sink import Sink
from edgetree.live.sinks.udp import UdpSink

__all__ = ["SinkOptions", "open_sinks"]

_MAPS: Final[dict[str, type[GeoJsonSink] | type[GeoPackageSink]]] = {
    ".geojson": GeoJsonSink,
    ".json": GeoJsonSink,
    ".gpkg": GeoPackageSink,
}


@dataclass(frozen=True)
class SinkOptions:
    """Where results go.

    Attributes:
        jsonl: file for JSON lines.
        csv: file for the table of stems per frame.
        stem_map: file for the map of stems, .geojson or .gpkg.
        origin: the map's place on Earth; None for local metres.
        bag: folder for a ROS 2 bag of standard messages; it must not exist.
        udp: address for datagrams, HOST:PORT.
        mqtt: broker, HOST or HOST:PORT.
        to_stdout: whether JSON lines go to stdout.
    """

    jsonl: Path | None = None
    csv: Path | None = None
    stem_map: Path | None = None
    origin: MapOrigin | None = None
    bag: Path | None = None
    udp: str | None = None
    mqtt: str | None = None
    to_stdout: bool = False


def open_sinks(options: SinkOptions, stack: ExitStack) -> list[Sink]:
    """Open the outputs.

    Args:
        options: where results go.
        stack: closes the outputs.

    Raises:
        InputError: a file cannot be written, or an address or name cannot be used.
        MissingPackage: the package for MQTT or for bags is not installed.
    """
    sinks: list[Sink] = []

    def add(sink: Sink) -> None:
        stack.callback(sink.close)
        sinks.append(sink)

    if options.to_stdout:
        add(JsonLinesSink(sys.stdout))
    if options.jsonl is not None:
        add(JsonLinesSink(options.jsonl))
    if options.csv is not None:
        add(CsvTracksSink(options.csv))
    if options.stem_map is not None:
        kind = _MAPS.get(options.stem_map.suffix.lower())
        if kind is None:
            raise InputError(f"--map is {options.stem_map}: expected a name in .geojson or .gpkg")
        add(kind(options.stem_map, options.origin))
    if options.bag is not None:
        add(BagSink(options.bag))
    if options.udp is not None:
        add(UdpSink(options.udp))
    if options.mqtt is not None:
        add(MqttSink(options.mqtt))
    return sinks
