"""The options of `edgetree run` for output files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.program.quoting import quoted
from edgetree.commands.options import RESULTS, Csv, Profiles, Report

if TYPE_CHECKING:
    from edgetree.commands.guarded_outputs import GuardedOutputs
    from edgetree.report import ReportHead
    from edgetree.results.csv_style import CsvStyle
    from edgetree.sinks import FileSink
    from edgetree.sources.source_list import SourceList

_Out: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER|VIDEO",
        help="Folder for drawn pictures, created if needed; or for a video or recording the name of"
        " a video to draw, such as drawn.mp4.",
    ),
]
_JsonLines: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.jsonl",
        help="File for the JSON lines, instead of stdout, which has short lines where it is a"
        " terminal.",
    ),
]
_Coco: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.json",
        help="File for COCO labels, to correct in a labelling tool; not for videos.",
    ),
]
_Map: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Map of the stems of a recording or drive with poses, .geojson or .gpkg, in metres.",
    ),
]


@dataclass(frozen=True)
class RunOutputs:
    """The options for output files."""

    panel = RESULTS

    out: _Out = None
    jsonl: _JsonLines = None
    csv: Csv = None
    profiles: Profiles = None
    coco: _Coco = None
    report: Report = None
    map: _Map = None

    def open(
        self,
        outputs: GuardedOutputs,
        sources: SourceList,
        model: str,
        score_threshold: float,
        reasons: list[str],
        head: ReportHead,
        style: CsvStyle,
        rate_hz: float | None,
    ) -> None:
        """Open the files but for the JSON lines.

        Args:
            outputs: Takes them.
            sources: Values of SOURCE, for the report and for names of pictures in labels.
            model: Name of the model file.
            score_threshold: Lowest score of trees.
            reasons: Why frames are left out, one of each frame, for the report.
            head: Title, place and area of the report.
            style: How CSV tables are written.
            rate_hz: Frames per second of a video to draw; None for those of the time stamps.
        """
        from edgetree import sinks
        from edgetree.results.csv_table import PROFILES, TREES
        from edgetree.sources.videos import is_video_name

        def map_sink(path: Path) -> FileSink[Any]:
            from edgetree.live.posed_map import PosedMapSink

            return PosedMapSink(path)

        named, words = sources.name, f"the model {model}"
        makers: dict[str, Callable[[Path], FileSink[Any]]] = {
            "csv": lambda path: sinks.CsvSink(path, TREES, style),
            "out": lambda path: (
                sinks.VideoSink(path, rate_hz) if is_video_name(path) else sinks.PicturesSink(path)
            ),
            "profiles": lambda path: sinks.CsvSink(path, PROFILES, style),
            "coco": lambda path: sinks.CocoSink(path, model, score_threshold, sources.common),
            "report": lambda path: sinks.ReportSink(path, named, words, reasons, head),
            "map": map_sink,
        }
        for name, make in makers.items():
            path = getattr(self, name)
            if path is not None:
                outputs.open(f"--{name} {path}", partial(make, path))

    def further(self, source: Path | None) -> str | None:
        """An output that was not asked for, as typed on the command line; None if none is left."""
        stem = quoted(f"{source.stem}_trees" if source is not None and source.stem else "trees")
        if self.out is None:
            return f"--out {stem}"
        return f"--report {stem}.html" if self.report is None else None

    def path_if(self, outputs: GuardedOutputs, name: str) -> Path | None:
        """The path of an output; None if it was not asked for or is not written."""
        path: Path | None = getattr(self, name)
        return path if outputs.holds(f"--{name} {path}") else None
