"""The options of `edgetree live` for outputs and recordings, and the signal that marks."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.errors import InputError
from basetree.program.console import note
from edgetree.commands.options import RESULTS, check_report

if TYPE_CHECKING:
    from edgetree.commands.guarded_outputs import GuardedOutputs
    from edgetree.live.recording import FrameRecorder
    from edgetree.live.results import LiveResult
    from edgetree.results.csv_style import CsvStyle
    from edgetree.sinks import MapOrigin, MqttSettings, Sink

_JsonLines: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="File for the JSON lines, instead of stdout (with --page: nowhere), which has short"
        " lines where it is a terminal. An older one is kept beside it."
    ),
]
_CsvFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--csv",
        help="CSV file to write, one row per stem and frame. An older one is kept beside it.",
    ),
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
        " axis in degrees clockwise from north.",
        show_default="none, the map is in metres",
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


_Record: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Record the input of the seconds around each mark here. A mark is the button of"
        " --page, POST /mark, or the signal SIGUSR1.",
    ),
]
_RecordAll: TypeAlias = Annotated[
    bool, typer.Option("--record-all", help="Record all input in the folder of --record.")
]


@dataclass(frozen=True)
class LiveOutputs:
    """The options for outputs."""

    panel = RESULTS

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
    def paths(self) -> dict[str, Path]:
        """The files and folders by option."""
        return {f"--{name}": value for name, value in vars(self).items() if isinstance(value, Path)}

    @property
    def are_given(self) -> bool:
        """Whether results go to a file or a controller."""
        return bool(self.paths or self.udp or self.mqtt)

    def check_places(self, source: str, *, has_depth: bool) -> None:
        """Raise InputError if an output needs stems in metres, and nothing tells them.

        Args:
            source: Value of SOURCE. A recording may tell distances by its motion.
            has_depth: Whether it has depth, or an option tells distances without it.
        """
        from basetree.errors import InputError
        from edgetree.sources.opening import is_stream

        if has_depth or is_stream(Path(source)):
            return
        for name in ("map", "report"):
            if getattr(self, name) is not None:
                raise InputError(
                    f"--{name} needs stems in metres, and {source} has no depth:"
                    " expected a source with depth, --depth, or without depth --camera and"
                    " --camera-height; `edgetree run` counts stems in the picture"
                )

    def origin(self) -> MapOrigin | None:
        """The place of the map; None for local metres.

        Raises:
            InputError: Options contradict each other, or a value is wrong.
        """
        check_report(self.report)
        if self.map_origin is None:
            return None
        if self.map is None:
            raise InputError("--map-origin given without --map: expected both")
        return _origin(self.map_origin)

    def check(self, mqtt: MqttSettings) -> None:
        """Check the values, and the files of MQTT.

        Args:
            mqtt: How messages go to the broker.

        Raises:
            InputError: Options contradict each other, a value is wrong, or a file cannot be read.
        """
        from edgetree.sinks.maps import check_map_name
        from edgetree.sinks.mqtt import MQTT_PORT
        from edgetree.sinks.network import host_and_port

        self.origin()
        if self.udp is not None:
            host_and_port(self.udp)
        if self.map is not None:
            check_map_name(self.map)
        if self.mqtt is None:
            given = [
                name for name, value in vars(mqtt).items() if value != getattr(type(mqtt), name)
            ]
            if given:
                name = given[0].replace("_", "-")
                raise InputError(f"--mqtt-{name} given without --mqtt: expected both")
            return
        host_and_port(self.mqtt, MQTT_PORT)
        mqtt.password()
        mqtt.tls_context()

    def open_controllers(self, outputs: GuardedOutputs, mqtt: MqttSettings) -> None:
        """Open the outputs to controllers, which replace no file and take states from the start.

        Args:
            outputs: Takes them.
            mqtt: How messages go to the broker.

        Raises:
            InputError: An address, name or file cannot be used.
            MissingPackage: The package for MQTT is not installed.
        """
        from edgetree import sinks

        if self.udp is not None:
            outputs.open(f"--udp {self.udp}", partial(sinks.UdpSink, self.udp))
        if self.mqtt is not None:
            outputs.open(f"--mqtt {self.mqtt}", partial(sinks.MqttSink, self.mqtt, mqtt))

    def open_files(
        self,
        outputs: GuardedOutputs,
        source: str,
        model: str,
        style: CsvStyle,
        *,
        to_stdout: bool,
        states: bool,
    ) -> None:
        """Open the files.

        Args:
            outputs: Takes them.
            source: Value of SOURCE, for the report.
            model: Name of the model file, likewise.
            style: How the table is written.
            to_stdout: Whether JSON lines go to stdout.
            states: Whether states are lines among the JSON lines.

        Raises:
            InputError: a file cannot be written.
            MissingPackage: The package for bags is not installed.
        """
        from edgetree import sinks

        makers: dict[str, Callable[[Any], Sink[LiveResult]]] = {
            "jsonl": lambda path: sinks.JsonLinesSink(path, states=states),
            "csv": lambda path: sinks.CsvTracksSink(path, style),
            "map": lambda path: sinks.open_map(path, self.origin(), keeps_older=True),
            "report": lambda path: sinks.StemReportSink(path, source, model, keeps_older=True),
            "bag": _bag,
        }
        if to_stdout:
            outputs.open("standard output", partial(_standard_output, states))
        for name, make in makers.items():
            target = getattr(self, name)
            if target is not None:
                outputs.open(f"--{name} {target}", partial(make, target), waits=True)


def _standard_output(states: bool) -> Sink[LiveResult]:
    """JSON lines for programs, with states if wanted; on a terminal a short line for each frame."""
    from edgetree.results.frame_line import live_line
    from edgetree.sinks import JsonLinesSink, LinesSink

    to_people = sys.stdout.isatty()
    return (
        LinesSink(sys.stdout, live_line) if to_people else JsonLinesSink(sys.stdout, states=states)
    )


def _bag(folder: Path) -> Sink[LiveResult]:
    """A bag; one of an earlier run is kept under another name."""
    from basetree.files.growing import keep_older
    from edgetree.sinks import BagSink
    from edgetree.sources.bags.names import is_bag

    for path in (folder, folder.with_name(f"unfinished_{folder.name}")):
        if path.is_dir() and is_bag(path):
            keep_older(path)
    return BagSink(folder)


def _origin(text: str) -> MapOrigin:
    """The place of the map.

    Raises:
        InputError: It has another form, or is out of range.
    """
    from edgetree.sinks import MapOrigin

    try:
        latitude, longitude, *rest = (float(part) for part in text.split(","))
        return MapOrigin(latitude, longitude, *rest)
    except InputError as error:
        raise InputError(f"--map-origin: {error}") from error
    except (TypeError, ValueError) as error:
        raise InputError(
            f"--map-origin is {text!r}: expected LAT,LON[,HEIGHT[,HEADING]], such as 60.5,24.3"
        ) from error


@dataclass(frozen=True)
class LiveRecordOptions:
    """The options about recordings of the input."""

    panel = "Recording"

    record: _Record = None
    record_all: _RecordAll = False

    def check(self) -> None:
        """Raise InputError if there is no folder to record in."""
        if self.record_all and self.record is None:
            raise InputError("--record-all given without --record: expected both")

    @contextmanager
    def recording(self, about: Callable[[], dict[str, Any]]) -> Iterator[FrameRecorder | None]:
        """Record during a block; yields None if it is not wanted.

        Args:
            about: Returns what recordings say about the run.

        Raises:
            InputError: The folder is a file.
            MissingPackage: Rosbags is not installed.
        """
        from edgetree.live.recording import FrameRecorder

        if self.record is None:
            yield None
            return
        recorder = FrameRecorder(self.record, everything=self.record_all, about=about())
        try:
            with _marked_by_signal(recorder):
                yield recorder
        finally:
            recorder.close()
            if recorder.status.written or recorder.status.failed:
                note(f"{recorder.status.line()} in {self.record}")


@contextmanager
def _marked_by_signal(recorder: FrameRecorder) -> Iterator[None]:
    """Mark at each SIGUSR1 during a block, where the system has it."""
    number = getattr(signal, "SIGUSR1", None)
    if number is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(number, lambda *_: recorder.mark("SIGUSR1"))
    try:
        yield
    finally:
        signal.signal(number, before)
