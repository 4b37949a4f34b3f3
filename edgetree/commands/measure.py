"""`edgetree measure`: the trees of one image in metres, for a person in the forest."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from edgetree.commands.options import (
    CAMERA_FILES,
    Csv,
    Depth,
    DepthCamera,
    DepthExtrinsics,
    DepthScale,
    Json,
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
from edgetree.console import note, print_json

if TYPE_CHECKING:
    from edgetree.frames.pipeline import FrameResult
    from edgetree.frames.rig import Rig
    from edgetree.frames.sources import Frame
    from edgetree.measure import MeasureSettings
    from edgetree.runtime.detector import TreeDetector

__all__ = ["measure"]

_Image: TypeAlias = Annotated[Path, typer.Argument(metavar="IMAGE", help="One image.")]
_Camera: TypeAlias = Annotated[
    Path, typer.Option(metavar="FILE[:NAME]", help=f"Camera file of the image. {CAMERA_FILES}")
]
_Model: TypeAlias = Annotated[
    str | None,
    typer.Option(help="An exported .onnx file; or rgb (the default) or depth, of the package."),
]
_Mask: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="In place of a model: a PNG of one channel and the image's size, 0 beside the trees"
        " and a number on each, drawn by hand or by another program."
    ),
]
_Picture: TypeAlias = Annotated[
    Path | None, typer.Option(help="File for the drawn picture, .jpg or .png.")
]


def measure(
    image: _Image,
    camera: _Camera,
    depth: Depth = None,
    model: _Model = None,
    mask: _Mask = None,
    up: Up = None,
    mounting: Mounting = None,
    depth_camera: DepthCamera = None,
    depth_extrinsics: DepthExtrinsics = None,
    depth_scale: DepthScale = None,
    stump_height: StumpHeight = None,
    out: _Picture = None,
    csv: Csv = None,
    score_threshold: ScoreThreshold = 0.5,
    threads: Threads = None,
    provider: Provider = "cpu",
    strict: Strict = True,
    as_json: Json = False,
) -> None:
    """Measure the trees of one image: diameter, DBH, cut height, lean and distance.

    Each value comes with its standard deviation, or the reason why there is none.
    """
    from edgetree.results.text_table import table_lines

    options = RigOptions(
        camera, up, mounting, depth_camera, depth_extrinsics, depth_scale, stump_height
    )
    task = _Task(image, depth, model, mask, out, csv, options)
    task.check()
    rig, settings = options.rig(depth), options.settings()
    detector = None
    source: dict[str, Any] = {"mask": str(mask)}
    if mask is None:
        detector, path = open_model(
            model or "rgb", threads, score_threshold, provider=provider, strict=strict
        )
        source = {"model": model_record(detector, path)}
    result = _examine(task, detector, rig, settings)
    task.write(result)
    if as_json:
        print_json(task.record(result, source))
    else:
        for line in table_lines(result.measurements or [], result.found.numbers):
            typer.echo(line)
    for line in task.summary(result):
        note(line)


@dataclass(frozen=True)
class _Task:
    """What was asked for."""

    image: Path
    depth: Path | None
    model: str | None
    mask: Path | None
    out: Path | None
    csv: Path | None
    options: RigOptions

    def check(self) -> None:
        """Refuse what contradicts itself before any work is done."""
        from edgetree.errors import InputError
        from edgetree.frames.sources import VIDEO_SUFFIXES
        from edgetree.results.pictures import PICTURE_SUFFIXES

        if self.image.is_dir() or self.image.suffix.lower() in VIDEO_SUFFIXES:
            raise InputError(f"{self.image} is no image: expected one; `edgetree run` takes more")
        if self.mask is not None and self.model is not None:
            raise InputError("--model given beside --mask: expected one of both")
        if self.mask is not None and self.depth is None:
            raise InputError("--mask given without --depth: expected the depth image to measure in")
        if self.out is not None and self.out.suffix.lower() not in PICTURE_SUFFIXES:
            raise InputError(
                f"--out is {self.out}: expected a file name ending in {', '.join(PICTURE_SUFFIXES)}"
            )
        outputs = {"--out": self.out, "--csv": self.csv}
        self.options.check_paths(outputs, self.image, self.depth, self.model, self.mask)

    def write(self, result: FrameResult) -> None:
        """The picture and the table, both or none."""
        from edgetree.results.atomic_files import replacing, text_file
        from edgetree.results.csv_table import write_header, write_rows
        from edgetree.results.pictures import draw_frame, encode_picture

        with ExitStack() as stack:
            if self.csv is not None:
                stream = stack.enter_context(text_file(self.csv))
                write_header(stream)
                write_rows(stream, result)
            if self.out is not None:
                picture = stack.enter_context(replacing(self.out))
                picture.write_bytes(encode_picture(draw_frame(result), self.out.suffix.lower()))

    def record(self, result: FrameResult, source: dict[str, Any]) -> dict[str, Any]:
        """All of it as one JSON object; `source` says where the trees are from."""
        from edgetree.results.json_records import frame_record

        assert result.camera is not None
        return {
            "schema": "edgetree.measure/1",
            **source,
            "depth": str(self.depth or self.image),
            "camera": result.camera.to_dict(),
            "frame": frame_record(result),
            "picture": None if self.out is None else str(self.out),
            "csv": None if self.csv is None else str(self.csv),
        }

    def summary(self, result: FrameResult) -> Iterator[str]:
        """What there is to know, where the files are, and what to type next."""
        if result.scaling is not None:
            yield result.scaling
        for name, path in (("picture", self.out), ("table", self.csv)):
            if path is not None:
                yield f"{name}: {path}"
        yield f"next: edgetree {self._following()}"

    def _following(self) -> str:
        model = "" if self.model is None else f" --model {quoted(self.model)}"
        mask = "" if self.mask is None else f" --mask {quoted(self.mask)}"
        given = f"{self.options.words(self.depth)}{model}{mask}"
        if self.out is None:
            return f"measure {quoted(self.image)}{given} --out {quoted(self.image.stem)}_trees.jpg"
        if self.csv is None:
            return f"measure {quoted(self.image)}{given} --csv {quoted(self.image.stem)}_trees.csv"
        return f"run FRAMES --depth DEPTHS{self.options.words(None)}{model} --csv trees.csv"


def _examine(
    task: _Task, detector: TreeDetector | None, rig: Rig, settings: MeasureSettings | None
) -> FrameResult:
    """Read the one frame, find its trees or take those of the mask, and measure them."""
    from edgetree.errors import InputError
    from edgetree.frames.mask_images import read_masks
    from edgetree.frames.pipeline import measure_frame, process
    from edgetree.frames.sources import open_source

    is_depth = detector is not None and detector.manifest.modality == "depth"
    if task.depth is None and not is_depth:
        raise InputError("--depth is missing: expected the depth image to measure in")
    depth_only = task.depth is None
    (frame,) = open_source(task.image, task.depth, depth_only=depth_only, rig=rig)
    if frame.depth_fault is not None:
        raise InputError(frame.depth_fault)
    if detector is not None:
        return process(frame, detector, rig, settings)
    assert task.mask is not None
    found = read_masks(task.mask, _size_px(frame))
    return measure_frame(frame, found, rig, settings)


def _size_px(frame: Frame) -> tuple[int, int]:
    assert frame.image is not None
    return frame.image.shape[1], frame.image.shape[0]
