"""`edgetree run`: detect and measure the trees of an image, a folder or a video."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.program.console import note, print_json
from edgetree.commands.option_groups import RigOptions, SessionOptions, expand_groups
from edgetree.commands.options import (
    Camera,
    Csv,
    Depth,
    Json,
    ModelByInput,
    Profiles,
    Report,
    ScoreThreshold,
    check_report,
    model_file,
    model_for,
    model_record,
    model_words,
    quoted,
)
from edgetree.commands.sharding import ShardedFrames, ShardOptions, run_sharded

if TYPE_CHECKING:
    from edgetree.frames.pipeline import FrameResult
    from edgetree.frames.sources import Frame

__all__ = ["run"]

_Source: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="SOURCE",
        help="An image, a folder of images, or a video; with --shards a folder or URL of images or"
        " of recordings.",
    ),
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
_StrictFrames: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--strict-frames",
        help="Stop at the first frame of a folder that cannot be read or measured, with exit code"
        " 2 and only the pictures so far. Otherwise such frames are left out, with exit code 1.",
    ),
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
    model: ModelByInput = None,
    depth: Depth = None,
    camera: Camera = None,
    rig_options: RigOptions,
    outputs: _Outputs,
    score_threshold: ScoreThreshold = 0.5,
    session: SessionOptions,
    shards: ShardOptions,
    strict_frames: _StrictFrames = False,
    as_json: Json = False,
) -> None:
    """Detect the trees of an image, a folder of images or a video.

    Prints one JSON line per frame: boxes, masks (COCO RLE) and keypoints in pixels, and with
    --depth and --camera the measurements of each tree in metres. Ctrl-C and SIGTERM keep the
    results so far.
    """
    from basetree.program.interrupts import interrupt_afterwards
    from edgetree.commands.frame_results import LeftOut, Totals, frame_results
    from edgetree.frames.pipeline import open_frames, process
    from edgetree.results.json_records import frame_record

    _check(source, depth, camera, model, rig_options, outputs)
    model = model_for(model, depth)
    if shards.are_given:
        work = ShardedFrames(source, depth, camera, model, rig_options, session, score_threshold)
        run_sharded(work, shards, vars(outputs), as_json=as_json)
        return
    detector, model_path = session.open_model(model, score_threshold)
    rig, settings = rig_options.rig(camera, depth), rig_options.settings()
    frames = open_frames(source, depth, rig=rig, detector=detector)
    totals, left_out = Totals(), LeftOut(strict_frames or not source.is_dir())
    is_interrupted = False
    records: list[dict[str, Any]] = []
    lines_to_stdout = not (outputs.jsonl or as_json)
    with _writer(
        outputs, source, model_path.name, score_threshold, lines_to_stdout, left_out.reasons
    ) as write:
        shown = not (lines_to_stdout and sys.stdout.isatty())

        def measure(frame: Frame) -> FrameResult:
            return process(frame, detector, rig, settings)

        try:
            for result in frame_results(frames, measure, left_out, shown=shown):
                record = frame_record(result)
                with interrupt_afterwards():
                    totals.add(result)
                    write(result, record)
                    if as_json:
                        records.append(record)
        except KeyboardInterrupt:
            if not totals.frames:
                raise
            is_interrupted = True
        left_out.check_some(totals.frames)
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
                **({"left_out": left_out.reasons} if left_out.reasons else {}),
                **({"interrupted": True} if is_interrupted else {}),
            }
        )
    for line in totals.lines():
        note(line)
    note(model_words(detector, model_path))
    _note_files(outputs)
    if is_interrupted:
        raise KeyboardInterrupt
    left_out.check_none(totals.frames)
    if outputs.out is None:
        options = f"{rig_options.words(depth, camera)} --model {quoted(model)} --out pictures"
        note(f"next: edgetree run {quoted(source)}{options}")
    else:
        images = depth if depth is not None and detector.manifest.takes_depth else source
        note(f"next: edgetree bench {quoted(model)} --frames {quoted(images)}")


def _note_files(outputs: _Outputs) -> None:
    """Say where the output files are."""
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


def _check(
    source: Path,
    depth: Path | None,
    camera: Path | None,
    model: str | None,
    rig_options: RigOptions,
    outputs: _Outputs,
) -> None:
    """Raise InputError if outputs overwrite files or do not fit the source."""
    from basetree.errors import InputError
    from basetree.files.names import VIDEO_SUFFIXES
    from basetree.files.writing import check_paths

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
    outputs: _Outputs,
    source: Path,
    model: str,
    score_threshold: float,
    lines_to_stdout: bool,
    left_out: list[str],
) -> Iterator[_Write]:
    """Open the output files; yields a function that writes a frame's result and its record."""
    from basetree.files.writing import output_folder, text_file
    from edgetree.frames.sources import as_typed
    from edgetree.report import report_file
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
            report = report_file(outputs.report, as_typed(source), words, left_out)
            others.append(stack.enter_context(report))
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
