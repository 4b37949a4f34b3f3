"""`edgetree run`: trees of an image, a folder or a video."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from edgetree.commands.options import Json, Model, Threads
from edgetree.console import note, print_json, track

if TYPE_CHECKING:
    from edgetree.pipeline import FrameResult
    from edgetree.runtime import TreeDetector

__all__ = ["run"]


def run(
    source: Annotated[Path, typer.Argument(help="An image, a folder of images, or a video.")],
    model: Model = "rgb",
    depth: Annotated[
        Path | None,
        typer.Option(
            help="Depth image of an image, or folder with one of the same stem for each image:"
            " 16-bit PNG, millimetres, 0 = no reading. With a depth model and without this,"
            " SOURCE itself is taken for depth."
        ),
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(help="Camera file (calib.camera/1 JSON), for metres."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for drawn pictures; made if needed.")
    ] = None,
    jsonl: Annotated[
        Path | None, typer.Option(help="File for the JSON lines, in place of stdout.")
    ] = None,
    score_threshold: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Leave out trees with a lower score.")
    ] = 0.5,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Find the trees of an image, a folder of images or a video.

    Prints one JSON line per frame: boxes, masks (COCO RLE) and keypoints in pixels, and with
    --depth and --camera the metres of each tree.
    """
    from calib import load_camera
    from edgetree.commands.options import open_model
    from edgetree.outputs import output_folder
    from edgetree.pipeline import process
    from edgetree.records import frame_record
    from edgetree.sinks import write_json_line, write_picture
    from edgetree.sources import open_source

    detector, model_path = open_model(model, threads, score_threshold)
    depth_only = depth is None and detector.manifest.modality == "depth"
    frames = open_source(source, depth, depth_only=depth_only)
    lens = None if camera is None else load_camera(camera)
    summary = _Summary(source, out, jsonl)
    records: list[dict[str, Any]] = []
    with ExitStack() as stack:
        pictures = None if out is None else stack.enter_context(output_folder(out))
        stream = stack.enter_context(_line_stream(jsonl))
        lines_on_screen = jsonl is None and not as_json and sys.stdout.isatty()
        for frame in track(frames, "detecting", frames.count, shown=not lines_on_screen):
            result = process(frame, detector, lens)
            summary.add(result)
            record = frame_record(result)
            if as_json:
                records.append(record)
            if jsonl is not None or not as_json:
                write_json_line(stream, record)
            if pictures is not None:
                write_picture(pictures, result)
    if as_json:
        print_json(
            {
                "schema": "edgetree.run/1",
                "source": str(source),
                "model": _model_record(model_path, detector),
                "frames": records,
                "pictures": None if out is None else str(out),
                "jsonl": None if jsonl is None else str(jsonl),
            }
        )
    summary.print()


@contextmanager
def _line_stream(jsonl: Path | None) -> Iterator[TextIO]:
    """Where JSON lines go; a file appears when all of them are in it."""
    if jsonl is None:
        yield sys.stdout
        return
    from edgetree.outputs import replacing

    with replacing(jsonl) as temporary, temporary.open("w", encoding="utf-8") as stream:
        yield stream


def _model_record(path: Path, detector: TreeDetector) -> dict[str, Any]:
    manifest = detector.manifest
    return {
        "path": str(path),
        "name": manifest.name,
        "modality": manifest.modality,
        "precision": manifest.precision,
        "score_threshold": detector.score_threshold,
    }


class _Summary:
    """What was done, where it is, and what to type next."""

    def __init__(self, source: Path, out: Path | None, jsonl: Path | None) -> None:
        self._source, self._out, self._jsonl = source, out, jsonl
        self._trees = 0
        self._times_ms: list[float] = []
        self._need: str | None = None

    def add(self, result: FrameResult) -> None:
        self._trees += len(result.trees)
        self._times_ms.append(result.detect_ms)
        self._need = result.metres_need

    def print(self) -> None:
        frames = len(self._times_ms)
        median_ms = sorted(self._times_ms)[frames // 2]
        note(f"{self._trees} trees in {frames} frames, {median_ms:.0f} ms per frame")
        if self._jsonl is not None:
            note(f"JSON lines: {self._jsonl}")
        if self._out is not None:
            note(f"pictures:   {self._out}")
        if self._need is not None:
            note(f"metres {self._need}")
        elif self._out is not None:
            note(f"next: edgetree bench {self._source}")
        if self._out is None:
            note(f"next: edgetree run {self._source} --out pictures")
