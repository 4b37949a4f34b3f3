"""`edgetree run`: trees of an image, a folder or a video."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO, TypeAlias

import typer

from edgetree.commands.options import Json, Model, Provider, Strict, Threads
from edgetree.console import note, print_json, track

if TYPE_CHECKING:
    from edgetree.pipeline import FrameResult
    from edgetree.runtime import TreeDetector
    from edgetree.sources import Frame, FrameSource

__all__ = ["run"]

_Source: TypeAlias = Annotated[
    Path, typer.Argument(metavar="SOURCE", help="An image, a folder of images, or a video.")
]
_Depth: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Depth image of an image, or folder with one of the same stem for each image:"
        " 16-bit PNG, millimetres, 0 = no reading. With a depth model and without this,"
        " SOURCE itself is taken for depth."
    ),
]
_Camera: TypeAlias = Annotated[
    Path | None, typer.Option(help="Camera file (calib.camera/1 JSON), for metres.")
]
_Up: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z",
        help="Direction away from gravity in the camera's frame (x right, y down, z forward), as"
        " an IMU gives it; 0,-1,0 for a level camera. Without, the ground's plane stands in.",
    ),
]
_Out: TypeAlias = Annotated[
    Path | None, typer.Option(help="Folder for drawn pictures; made if needed.")
]
_JsonLines: TypeAlias = Annotated[
    Path | None, typer.Option(help="File for the JSON lines, in place of stdout.")
]
_ScoreThreshold: TypeAlias = Annotated[
    float, typer.Option(min=0.0, max=1.0, help="Leave out trees with a lower score.")
]


def run(
    source: _Source,
    model: Model = "rgb",
    depth: _Depth = None,
    camera: _Camera = None,
    up: _Up = None,
    out: _Out = None,
    jsonl: _JsonLines = None,
    score_threshold: _ScoreThreshold = 0.5,
    threads: Threads = None,
    provider: Provider = "cpu",
    strict: Strict = True,
    as_json: Json = False,
) -> None:
    """Find the trees of an image, a folder of images or a video.

    Prints one JSON line per frame: boxes, masks (COCO RLE) and keypoints in pixels, and with
    --depth and --camera the metres of each tree.
    """
    from calib import load_camera
    from edgetree.commands.options import open_model
    from edgetree.pipeline import process
    from edgetree.sources import open_source

    detector, model_path = open_model(
        model, threads, score_threshold, provider=provider, strict=strict
    )
    depth_only = depth is None and detector.manifest.modality == "depth"
    frames = open_source(source, depth, depth_only=depth_only)
    lens = None if camera is None else load_camera(camera)
    up_camera = None if up is None else _direction(up)
    work = _Work(source, model, model_path, out, jsonl, as_json)
    work.do(frames, lambda frame: process(frame, detector, lens, up_camera))
    if as_json:
        print_json(work.to_dict(detector))
    for line in work.summary():
        note(line)


def _direction(text: str) -> tuple[float, float, float]:
    from edgetree.errors import InputError

    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"--up is {text!r}: expected three numbers, such as 0,-1,0") from error
    return x, y, z


@dataclass
class _Work:
    """What was asked for, and what has come of it so far."""

    source: Path
    model: str
    model_path: Path
    out: Path | None
    jsonl: Path | None
    as_json: bool
    trees: int = 0
    times_ms: list[float] = field(default_factory=list)
    records: list[dict[str, Any]] = field(default_factory=list)
    metres_need: str | None = None

    def do(self, frames: FrameSource, examine: Callable[[Frame], FrameResult]) -> None:
        """Detect, measure and write frame by frame."""
        from edgetree.outputs import output_folder
        from edgetree.records import frame_record
        from edgetree.sinks import write_json_line, write_picture

        with ExitStack() as stack:
            pictures = None if self.out is None else stack.enter_context(output_folder(self.out))
            stream = stack.enter_context(self._line_stream())
            on_screen = not (self.jsonl or self.as_json) and sys.stdout.isatty()
            for frame in track(frames, "detecting", frames.count, shown=not on_screen):
                result = examine(frame)
                record = frame_record(result)
                self._count(result)
                if self.as_json:
                    self.records.append(record)
                if stream is not None:
                    write_json_line(stream, record)
                if pictures is not None:
                    write_picture(pictures, result)

    @contextmanager
    def _line_stream(self) -> Iterator[TextIO | None]:
        """Where JSON lines go; a file appears when all of them are in it."""
        if self.jsonl is None:
            yield None if self.as_json else sys.stdout
            return
        from edgetree.outputs import replacing

        with replacing(self.jsonl) as temporary, temporary.open("w", encoding="utf-8") as stream:
            yield stream

    def _count(self, result: FrameResult) -> None:
        self.trees += len(result.trees)
        self.times_ms.append(result.detect_ms)
        self.metres_need = result.metres_need

    def to_dict(self, detector: TreeDetector) -> dict[str, Any]:
        """The one object of --json."""
        manifest = detector.manifest
        return {
            "schema": "edgetree.run/1",
            "source": str(self.source),
            "model": {
                "path": str(self.model_path),
                "name": manifest.name,
                "modality": manifest.modality,
                "precision": manifest.precision,
                "provider": detector.session.provider,
            },
            "score_threshold": detector.score_threshold,
            "frames": self.records,
            "pictures": None if self.out is None else str(self.out),
            "jsonl": None if self.jsonl is None else str(self.jsonl),
        }

    def summary(self) -> Iterator[str]:
        """What was done, where it is, and what to type next."""
        frames = len(self.times_ms)
        median_ms = sorted(self.times_ms)[frames // 2]
        yield f"{self.trees} trees in {frames} frame(s), {median_ms:.0f} ms each to detect"
        if self.metres_need is not None:
            yield f"metres {self.metres_need}"
        if self.jsonl is not None:
            yield f"JSON lines: {self.jsonl}"
        if self.out is not None:
            yield f"pictures: {self.out}"
            yield f"next: edgetree bench {self.source} --model {self.model}"
        else:
            yield f"next: edgetree run {self.source} --model {self.model} --out pictures"
