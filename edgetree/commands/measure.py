"""`edgetree measure`: measure the trees of one image."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.program.console import note, print_json
from edgetree.commands.option_groups import RigOptions, SessionOptions, expand_groups
from edgetree.commands.options import (
    CAMERA_FILES,
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
    from edgetree.frames.rig import Rig
    from edgetree.measure import MeasureSettings
    from edgetree.runtime.detector import TreeDetector

__all__ = ["measure"]

_Image: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="IMAGE",
        help="One image; with --shards a folder or URL of images or of recordings.",
    ),
]
_Camera: TypeAlias = Annotated[
    Path, typer.Option(metavar="FILE[:NAME]", help=f"Camera file of the image. {CAMERA_FILES}")
]
_Mask: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Mask image to use instead of a model: a PNG with one channel and the size of the"
        " image, 0 for background and a number for each tree."
    ),
]
_Picture: TypeAlias = Annotated[
    Path | None, typer.Option(help="File for the drawn picture, .jpg or .png.")
]


@dataclass(frozen=True)
class _Outputs:
    """The options for output files."""

    out: _Picture = None
    csv: Csv = None
    profiles: Profiles = None
    report: Report = None


@expand_groups
def measure(
    image: _Image,
    camera: _Camera,
    *,
    depth: Depth = None,
    model: ModelByInput = None,
    mask: _Mask = None,
    rig_options: RigOptions,
    outputs: _Outputs,
    score_threshold: ScoreThreshold = 0.5,
    session: SessionOptions,
    shards: ShardOptions,
    as_json: Json = False,
) -> None:
    """Measure the trees of one image: diameter, DBH, cut height, lean and distance.

    Each value comes with its standard deviation, or the reason why it could not be measured.
    """
    from edgetree.commands.frame_results import unlike_words
    from edgetree.results.text_table import table_lines

    inputs = _Inputs(image, camera, depth, model, mask, rig_options)
    if shards.are_given:
        name = inputs.model_for_shards(outputs)
        work = ShardedFrames(image, depth, camera, name, rig_options, session, score_threshold)
        run_sharded(work, shards, vars(outputs), as_json=as_json)
        return
    inputs.check(outputs)
    rig, settings = rig_options.rig(camera, depth), rig_options.settings()
    detector = None
    trees_from: dict[str, Any] = {"mask": str(mask)}
    trees_from_words = f"the mask {mask}"
    if mask is None:
        detector, model_path = session.open_model(model_for(model, depth), score_threshold)
        trees_from = {"model": model_record(detector, model_path)}
        trees_from_words = f"the model {model_path.name}"
    result = inputs.process(detector, rig, settings)
    _write(result, outputs, str(image), trees_from_words)
    if as_json:
        from edgetree.results.json_records import frame_record

        assert result.camera is not None
        print_json(
            {
                "schema": "edgetree.measure/1",
                **trees_from,
                "depth": str(depth or image),
                "camera": result.camera.to_dict(),
                "frame": frame_record(result),
                "picture": None if outputs.out is None else str(outputs.out),
                "csv": None if outputs.csv is None else str(outputs.csv),
                "profiles": None if outputs.profiles is None else str(outputs.profiles),
            }
        )
    else:
        for line in table_lines(result.measurements or [], result.found.numbers):
            typer.echo(line)
    if detector is not None:
        note(model_words(detector, model_path))
    if result.scaling is not None:
        note(result.scaling)
    if result.trees.unlike is not None:
        words = unlike_words(result.frame.name, result.trees.unlike)
        note(f"unlike the training pictures: {words}")
    for name, path in (
        ("picture", outputs.out),
        ("table", outputs.csv),
        ("profiles", outputs.profiles),
        ("report", outputs.report),
    ):
        if path is not None:
            note(f"{name}: {path}")
    note(f"next: edgetree {inputs.next_command(outputs.out, outputs.csv)}")


@dataclass(frozen=True)
class _Inputs:
    """The options that say what to measure."""

    image: Path
    camera: Path
    depth: Path | None
    model: str | None
    mask: Path | None
    rig_options: RigOptions

    def check(self, outputs: _Outputs) -> None:
        """Raise InputError if options contradict each other, or an output overwrites a file."""
        from basetree.errors import InputError
        from basetree.files.names import VIDEO_SUFFIXES
        from edgetree.results.pictures import PICTURE_SUFFIXES

        if self.image.is_dir() or self.image.suffix.lower() in VIDEO_SUFFIXES:
            raise InputError(
                f"{self.image} is not an image: expected one; use `edgetree run` for several"
            )
        if self.mask is not None and self.model is not None:
            raise InputError("--model given with --mask: expected only one")
        if self.mask is not None and self.depth is None:
            raise InputError("--mask given without --depth: expected the depth image to measure in")
        out = outputs.out
        if out is not None and out.suffix.lower() not in PICTURE_SUFFIXES:
            suffixes = ", ".join(PICTURE_SUFFIXES)
            raise InputError(f"--out is {out}: expected a file name ending in {suffixes}")
        check_report(outputs.report)
        self._check_paths(outputs)

    def model_for_shards(self, outputs: _Outputs) -> str:
        """The model for several images; raises InputError if options do not fit them."""
        from basetree.errors import InputError

        if self.mask is not None:
            raise InputError("--mask given with --shards: expected a model")
        self._check_paths(outputs)
        return model_for(self.model, self.depth)

    def _check_paths(self, outputs: _Outputs) -> None:
        from basetree.files.writing import check_paths

        check_paths(
            {f"--{name}": path for name, path in vars(outputs).items()},
            {
                "source": self.image,
                "--depth": self.depth,
                "--model": model_file(self.model),
                "--mask": self.mask,
                **self.rig_options.files(self.camera),
            },
        )

    def process(
        self, detector: TreeDetector | None, rig: Rig, settings: MeasureSettings | None
    ) -> FrameResult:
        """Read the frame and measure the trees that the detector finds, or those of the mask."""
        from basetree.errors import InputError
        from edgetree.frames.mask_images import read_masks
        from edgetree.frames.pipeline import measure_frame, open_frames, process

        if self.depth is None and not (detector and detector.manifest.takes_depth):
            raise InputError("--depth is missing: expected the depth image to measure in")
        (frame,) = open_frames(self.image, self.depth, rig=rig, detector=detector)
        if frame.depth_fault is not None:
            raise InputError(frame.depth_fault)
        if detector is not None:
            return process(frame, detector, rig, settings)
        assert self.mask is not None
        assert frame.image is not None
        height, width = frame.image.shape[:2]
        return measure_frame(frame, read_masks(self.mask, (width, height)), rig, settings)

    def next_command(self, out: Path | None, csv: Path | None) -> str:
        """A command to try next."""
        image, stem = quoted(self.image), quoted(self.image.stem)
        model = "" if self.model is None else f" --model {quoted(self.model)}"
        mask = "" if self.mask is None else f" --mask {quoted(self.mask)}"
        options = f"{self.rig_options.words(self.depth, self.camera)}{model}{mask}"
        if out is None:
            return f"measure {image}{options} --out {stem}_trees.jpg"
        if csv is None:
            return f"measure {image}{options} --csv {stem}_trees.csv"
        options = f"{self.rig_options.words(None, self.camera)}{model}"
        return f"run FRAMES --depth DEPTHS{options} --csv trees.csv"


def _write(result: FrameResult, outputs: _Outputs, source: str, trees_from: str) -> None:
    """Write the picture, the table and the report; if one fails, none is written."""
    from basetree.files.writing import replacing, text_file
    from edgetree.report import report_file
    from edgetree.results.csv_table import write_header, write_rows
    from edgetree.results.pictures import draw_frame, encode_picture
    from edgetree.results.profile_table import profiles_file

    with ExitStack() as stack:
        if outputs.csv is not None:
            stream = stack.enter_context(text_file(outputs.csv))
            write_header(stream)
            write_rows(stream, result)
        if outputs.profiles is not None:
            stack.enter_context(profiles_file(outputs.profiles))(result)
        if outputs.report is not None:
            add = stack.enter_context(report_file(outputs.report, source, trees_from))
            add(result)
        if outputs.out is not None:
            picture = stack.enter_context(replacing(outputs.out))
            data = encode_picture(draw_frame(result), outputs.out.suffix.lower())
            picture.write(data)
