"""`edgetree run`: trees of an image, a folder or a video."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO, TypeAlias

import typer

from edgetree.commands.options import (
    Camera,
    Csv,
    Depth,
    DepthCamera,
    DepthExtrinsics,
    DepthScale,
    Json,
    Model,
    Mounting,
    Provider,
    RigOptions,
    ScoreThreshold,
    Strict,
    StumpHeight,
    Threads,
    Up,
    model_record,
    open_model,
    quoted,
)
from edgetree.console import note, print_json, track

if TYPE_CHECKING:
    from edgetree.frames.pipeline import FrameResult
    from edgetree.frames.sources import Frame, FrameSource
    from edgetree.runtime.detector import TreeDetector

__all__ = ["run"]

_Source: TypeAlias = Annotated[
    Path, typer.Argument(metavar="SOURCE", help="An image, a folder of images, or a video.")
]
_Out: TypeAlias = Annotated[
    Path | None, typer.Option(help="Folder for drawn pictures; made if needed.")
]
_JsonLines: TypeAlias = Annotated[
    Path | None, typer.Option(help="File for the JSON lines, in place of stdout.")
]
_Coco: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="File for COCO labels, to be corrected in a labelling tool; of images only."),
]


def run(
    source: _Source,
    model: Model = "rgb",
    depth: Depth = None,
    camera: Camera = None,
    up: Up = None,
    mounting: Mounting = None,
    depth_camera: DepthCamera = None,
    depth_extrinsics: DepthExtrinsics = None,
    depth_scale: DepthScale = None,
    stump_height: StumpHeight = None,
    out: _Out = None,
    jsonl: _JsonLines = None,
    csv: Csv = None,
    coco: _Coco = None,
    score_threshold: ScoreThreshold = 0.5,
    threads: Threads = None,
    provider: Provider = "cpu",
    strict: Strict = True,
    as_json: Json = False,
) -> None:
    """Find the trees of an image, a folder of images or a video.

    Prints one JSON line per frame: boxes, masks (COCO RLE) and keypoints in pixels, and with
    --depth and --camera the metres of each tree.
    """
    from edgetree.frames.pipeline import process
    from edgetree.frames.sources import open_source

    options = RigOptions(
        camera, up, mounting, depth_camera, depth_extrinsics, depth_scale, stump_height
    )
    outputs = {"--out": out, "--jsonl": jsonl, "--csv": csv, "--coco": coco}
    options.check_paths(outputs, source, depth, model)
    _check_labels(coco, source)
    detector, model_path = open_model(
        model, threads, score_threshold, provider=provider, strict=strict
    )
    depth_only = depth is None and detector.manifest.modality == "depth"
    rig, settings = options.rig(depth), options.settings()
    frames = open_source(source, depth, depth_only=depth_only, rig=rig)
    following = _following(source, depth, options, model, out, detector.manifest.modality)
    work = _Work(source, model_path, out, jsonl, csv, coco, score_threshold, as_json, following)
    work.do(frames, lambda frame: process(frame, detector, rig, settings))
    if as_json:
        print_json(work.to_dict(detector))
    for line in work.summary():
        note(line)


def _following(
    source: Path, depth: Path | None, options: RigOptions, model: str, out: Path | None, sees: str
) -> str:
    """What to type next; ``sees`` is the model's modality."""
    if out is None:
        return f"run {quoted(source)}{options.words(depth)} --model {quoted(model)} --out pictures"
    seen = depth if depth is not None and sees == "depth" else source
    return f"bench {quoted(seen)} --model {quoted(model)}"


def _check_labels(coco: Path | None, source: Path) -> None:
    """Labels name the pictures that they are for."""
    from edgetree.errors import InputError
    from edgetree.frames.sources import VIDEO_SUFFIXES

    if coco is not None and source.suffix.lower() in VIDEO_SUFFIXES and source.is_file():
        raise InputError(
            f"--coco is for pictures, and source {source} is a video: expected an image or a folder"
        )


@dataclass
class _Work:
    """What was asked for, and what has come of it so far."""

    source: Path
    model_path: Path
    out: Path | None
    jsonl: Path | None
    csv: Path | None
    coco: Path | None
    score_threshold: float
    as_json: bool
    following: str
    trees: int = 0
    times_ms: list[float] = field(default_factory=list)
    records: list[dict[str, Any]] = field(default_factory=list)
    metres_need: str | None = None
    scaling: str | None = None
    faults: list[str] = field(default_factory=list)

    def do(self, frames: FrameSource, examine: Callable[[Frame], FrameResult]) -> None:
        """Detect, measure and write frame by frame."""
        from edgetree.results.atomic_files import output_folder, text_file
        from edgetree.results.coco_labels import labels_file
        from edgetree.results.csv_table import write_header, write_rows
        from edgetree.results.json_records import frame_record, write_json_line
        from edgetree.results.pictures import write_picture

        with ExitStack() as stack:
            pictures = None if self.out is None else stack.enter_context(output_folder(self.out))
            stream = stack.enter_context(self._line_stream())
            table = None if self.csv is None else stack.enter_context(text_file(self.csv))
            add_labels = None
            if self.coco is not None:
                labels = labels_file(self.coco, self.model_path.name, self.score_threshold)
                add_labels = stack.enter_context(labels)
            if table is not None:
                write_header(table)
            on_screen = not (self.jsonl or self.as_json) and sys.stdout.isatty()
            for frame in track(frames, "detecting", frames.count, shown=not on_screen):
                result = examine(frame)
                record = frame_record(result)
                self._count(result)
                if self.as_json:
                    self.records.append(record)
                if stream is not None:
                    write_json_line(stream, record)
                if table is not None:
                    write_rows(table, result)
                if pictures is not None:
                    write_picture(pictures, result)
                if add_labels is not None:
                    add_labels(result)

    @contextmanager
    def _line_stream(self) -> Iterator[TextIO | None]:
        """Where JSON lines go; a file appears when all of them are in it."""
        if self.jsonl is None:
            yield None if self.as_json else sys.stdout
            return
        from edgetree.results.atomic_files import text_file

        with text_file(self.jsonl) as stream:
            yield stream

    def _count(self, result: FrameResult) -> None:
        self.trees += len(result.trees)
        self.times_ms.append(result.detect_ms)
        self.metres_need = self.metres_need or result.metres_need
        self.scaling = self.scaling or result.scaling
        if result.frame.depth_fault is not None:
            self.faults.append(result.frame.depth_fault)

    def to_dict(self, detector: TreeDetector) -> dict[str, Any]:
        """The one object of --json."""
        return {
            "schema": "edgetree.run/1",
            "source": str(self.source),
            "model": model_record(detector, self.model_path),
            "score_threshold": detector.score_threshold,
            "frames": self.records,
            "pictures": None if self.out is None else str(self.out),
            "jsonl": None if self.jsonl is None else str(self.jsonl),
            "csv": None if self.csv is None else str(self.csv),
            "coco": None if self.coco is None else str(self.coco),
        }

    def summary(self) -> Iterator[str]:
        """What was done, where it is, and what to type next."""
        frames = len(self.times_ms)
        median_ms = sorted(self.times_ms)[frames // 2]
        yield f"{self.trees} trees in {frames} frame(s), {median_ms:.0f} ms each to detect"
        if self.metres_need is not None:
            yield f"metres {self.metres_need}"
        if self.scaling is not None:
            yield self.scaling
        if self.faults:
            yield f"depth not to be believed in {len(self.faults)} frame(s): {self.faults[0]}"
        for name, path in (
            ("JSON lines", self.jsonl),
            ("table", self.csv),
            ("labels", self.coco),
            ("pictures", self.out),
        ):
            if path is not None:
                yield f"{name}: {path}"
        yield f"next: edgetree {self.following}"
