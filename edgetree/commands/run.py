"""`edgetree run`: detect and measure the trees of an image, a folder or a video."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from edgetree.commands.option_groups import RigOptions, SessionOptions, expand_groups
from edgetree.commands.options import (
    Camera,
    Csv,
    Depth,
    Json,
    Model,
    Profiles,
    Report,
    ScoreThreshold,
    check_report,
    model_file,
    model_record,
    quoted,
)
from edgetree.console import note, print_json, track

if TYPE_CHECKING:
    from edgetree.frames.pipeline import FrameResult

__all__ = ["run"]

_Source: TypeAlias = Annotated[
    Path, typer.Argument(metavar="SOURCE", help="An image, a folder of images, or a video.")
]
_Out: TypeAlias = Annotated[
    Path | None, typer.Option(help="Folder for drawn pictures; created if needed.")
]
_JsonLines: TypeAlias = Annotated[
    Path | None, typer.Option(help="File for the JSON lines, instead of stdout.")
]
_Coco: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="File for COCO labels, to correct in a labelling tool; not for videos."),
]
_Write: TypeAlias = "Callable[[FrameResult, dict[str, Any]], None]"


@dataclass(frozen=True)
class _Outputs:
    """The options for output files."""

    out: _Out = None
    jsonl: _JsonLines = None
    csv: Csv = None
    profiles: Profiles = None
    coco: _Coco = None
    report: Report = None


@expand_groups
def run(
    source: _Source,
    *,
    model: Model = "rgb",
    depth: Depth = None,
    camera: Camera = None,
    rig_options: RigOptions,
    outputs: _Outputs,
    score_threshold: ScoreThreshold = 0.5,
    session: SessionOptions,
    as_json: Json = False,
) -> None:
    """Detect the trees of an image, a folder of images or a video.

    Prints one JSON line per frame: boxes, masks (COCO RLE) and keypoints in pixels, and with
    --depth and --camera the measurements of each tree in metres.
    """
    from edgetree.frames.pipeline import open_frames, process
    from edgetree.results.json_records import frame_record

    _check(source, depth, camera, model, rig_options, outputs)
    detector, model_path = session.open_model(model, score_threshold)
    rig, settings = rig_options.rig(camera, depth), rig_options.settings()
    frames = open_frames(source, depth, rig=rig, detector=detector)
    totals = _Totals()
    records: list[dict[str, Any]] = []
    lines_to_stdout = not (outputs.jsonl or as_json)
    with _writer(outputs, source, model_path.name, score_threshold, lines_to_stdout) as write:
        shown = not (lines_to_stdout and sys.stdout.isatty())
        for frame in track(frames, "detecting", frames.count, shown=shown):
            result = process(frame, detector, rig, settings)
            record = frame_record(result)
            totals.add(result)
            write(result, record)
            if as_json:
                records.append(record)
    if as_json:
        paths = {"pictures": outputs.out, "jsonl": outputs.jsonl}
        paths |= {"csv": outputs.csv, "profiles": outputs.profiles, "coco": outputs.coco}
        print_json(
            {
                "schema": "edgetree.run/1",
                "source": str(source),
                "model": model_record(detector, model_path),
                "score_threshold": detector.score_threshold,
                "frames": records,
                **{name: None if path is None else str(path) for name, path in paths.items()},
            }
        )
    for line in totals.lines():
        note(line)
    for name, path in (
        ("JSON lines", outputs.jsonl),
        ("table", outputs.csv),
        ("profiles", outputs.profiles),
        ("labels", outputs.coco),
        ("pictures", outputs.out),
        ("report", outputs.report),
    ):
        if path is not None:
            note(f"{name}: {path}")
    if outputs.out is None:
        options = f"{rig_options.words(depth, camera)} --model {quoted(model)} --out pictures"
        note(f"next: edgetree run {quoted(source)}{options}")
    else:
        images = depth if depth is not None and detector.manifest.takes_depth else source
        note(f"next: edgetree bench {quoted(images)} --model {quoted(model)}")


def _check(
    source: Path,
    depth: Path | None,
    camera: Path | None,
    model: str,
    rig_options: RigOptions,
    outputs: _Outputs,
) -> None:
    """Raise InputError if outputs overwrite files or do not fit the source."""
    from edgetree.errors import InputError
    from edgetree.frames.sources import VIDEO_SUFFIXES
    from edgetree.results.atomic_files import check_paths

    check_paths(
        {f"--{name}": path for name, path in vars(outputs).items()},
        {
            "source": source,
            "--depth": depth,
            "--model": model_file(model),
            **rig_options.files(camera),
        },
    )
    check_report(outputs.report)
    if outputs.coco and source.suffix.lower() in VIDEO_SUFFIXES and source.is_file():
        raise InputError(f"source {source} is a video: expected images, as --coco is given")


@contextmanager
def _writer(
    outputs: _Outputs, source: Path, model: str, score_threshold: float, lines_to_stdout: bool
) -> Iterator[_Write]:
    """Open the output files; yields a function that writes a frame's result and its record."""
    from edgetree.frames.sources import as_typed
    from edgetree.report import report_file
    from edgetree.results.atomic_files import output_folder, text_file
    from edgetree.results.coco_labels import labels_file
    from edgetree.results.csv_table import write_header, write_rows
    from edgetree.results.json_records import write_json_line
    from edgetree.results.pictures import write_picture
    from edgetree.results.profile_table import profiles_file

    with ExitStack() as stack:
        folder = None if outputs.out is None else stack.enter_context(output_folder(outputs.out))
        lines = sys.stdout if lines_to_stdout else None
        if outputs.jsonl is not None:
            lines = stack.enter_context(text_file(outputs.jsonl))
        table = None if outputs.csv is None else stack.enter_context(text_file(outputs.csv))
        others: list[Callable[[FrameResult], None]] = []
        if outputs.profiles is not None:
            others.append(stack.enter_context(profiles_file(outputs.profiles)))
        if outputs.coco is not None:
            others.append(stack.enter_context(labels_file(outputs.coco, model, score_threshold)))
        if outputs.report is not None:
            words = f"the model {model}"
            others.append(stack.enter_context(report_file(outputs.report, as_typed(source), words)))
        if table is not None:
            write_header(table)

        def write(result: FrameResult, record: dict[str, Any]) -> None:
            if lines is not None:
                write_json_line(lines, record)
            if table is not None:
                write_rows(table, result)
            if folder is not None:
                write_picture(folder, result)
            for add in others:
                add(result)

        yield write


@dataclass
class _Totals:
    """Counts over all frames, for the summary."""

    trees: int = 0
    times_ms: list[float] = field(default_factory=list)
    metres_need: str | None = None
    scaling: str | None = None
    faults: list[str] = field(default_factory=list)

    def add(self, result: FrameResult) -> None:
        """Count a frame."""
        self.trees += len(result.trees)
        self.times_ms.append(result.detect_ms)
        self.metres_need = self.metres_need or result.metres_need
        self.scaling = self.scaling or result.scaling
        if result.frame.depth_fault is not None:
            self.faults.append(result.frame.depth_fault)

    def lines(self) -> Iterator[str]:
        """The summary."""
        frames = len(self.times_ms)
        median_ms = sorted(self.times_ms)[frames // 2]
        yield f"{self.trees} trees in {frames} frame(s), {median_ms:.0f} ms each to detect"
        if self.metres_need is not None:
            yield f"metres {self.metres_need}"
        if self.scaling is not None:
            yield self.scaling
        if self.faults:
            yield f"unusable depth in {len(self.faults)} frame(s): {self.faults[0]}"
