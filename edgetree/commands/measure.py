"""`edgetree measure`: measure the trees of one image."""

from __future__ import annotations

import shutil
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.program.console import keep_remarks, note, note_remarks, print_json, tell
from basetree.program.options import expand_groups
from basetree.program.quoting import quoted
from edgetree.commands.csv_options import CsvOptions
from edgetree.commands.option_groups import ReportOptions, RigOptions, SessionOptions
from edgetree.commands.options import (
    CAMERA,
    CAMERA_FILES,
    INPUT,
    RESULTS,
    Cloud,
    Csv,
    Depth,
    Json,
    ModelByInput,
    Profiles,
    Report,
    Right,
    ScoreThreshold,
    check_distances,
    check_extrinsic,
    check_report,
    model_file,
    model_record,
    model_words,
)
from edgetree.commands.sharding import ShardedFrames, ShardOptions, run_sharded

if TYPE_CHECKING:
    from calib.stereo import StereoPair
    from edgetree.frames.pipeline import FrameResult
    from edgetree.frames.rig import Rig
    from edgetree.measure import MeasureSettings
    from edgetree.report import ReportHead
    from edgetree.results.csv_style import CsvStyle
    from edgetree.runtime.detector import TreeDetector

_Image: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="IMAGE",
        help="One image, or a point cloud for the view of a camera with --extrinsic; with --shards"
        " a folder or URL of images or of recordings.",
    ),
]
_Camera: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE[:NAME]",
        help=f"Camera file of the image; needed with depth. {CAMERA_FILES} Without depth and"
        " camera, the focal length is that of the picture's EXIF.",
        rich_help_panel=CAMERA,
    ),
]
_Mask: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Mask image to use instead of a model: a PNG with one channel and the size of the"
        " image, 0 for background and a number for each tree."
    ),
]
_Picture: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="FILE", help="File for the drawn picture, .jpg or .png.")
]


@dataclass(frozen=True)
class _Inputs:
    """The options that say what to measure, and how its trees are found."""

    panel = INPUT

    depth: Depth = None
    right: Right = None
    cloud: Cloud = None
    model: ModelByInput = None
    mask: _Mask = None
    score_threshold: ScoreThreshold = 0.5

    @property
    def distances(self) -> Path | None:
        """The file that tells distances: a depth image or a point cloud."""
        return self.depth or self.cloud

    def check_shards(self) -> None:
        """Raise InputError if an option is given that shards do not take."""
        from basetree.errors import InputError

        for name in ("mask", "right", "cloud"):
            if getattr(self, name) is not None:
                raise InputError(f"--{name} given with --shards: expected a model and depth images")

    def check(
        self, image: Path, camera: Path | None, rig_options: RigOptions, outputs: _Outputs
    ) -> None:
        """Raise InputError if options contradict each other."""
        from basetree.errors import InputError
        from edgetree.results.pictures import PICTURE_SUFFIXES
        from edgetree.sources.folders import depth_alone
        from edgetree.sources.phones.opening import is_capture
        from edgetree.sources.videos import is_video

        if not image.exists():
            raise InputError(f"{image} does not exist: expected an image")
        if image.is_dir() or is_capture(image) or is_video(image):
            raise InputError(
                f"{image} is not an image: expected one; use `edgetree run` for several"
            )
        if self.mask is not None and self.model is not None:
            raise InputError("--model given with --mask: expected only one")
        without_depth = rig_options.references() is not None
        check_distances(self.depth, self.right, self.cloud, without_depth=without_depth)
        check_extrinsic(rig_options.extrinsic, image, self.distances)
        has_depth = (self.distances or self.right or depth_alone(image)) is not None
        if self.mask is not None and not (has_depth or without_depth):
            raise InputError(
                "--mask given without --depth: expected the depth image to measure in, or"
                " --camera-height or --marker"
            )
        if camera is None and not without_depth:
            also = (
                ""
                if has_depth
                else "; and --depth unless the image holds depth, or without depth"
                " --camera-height, --marker or --scale-bar"
            )
            raise InputError(f"--camera is missing: expected the camera file of the image{also}")
        out = outputs.out
        if out is not None and out.suffix.lower() not in PICTURE_SUFFIXES:
            suffixes = ", ".join(PICTURE_SUFFIXES)
            raise InputError(f"--out is {out}: expected a file name ending in {suffixes}")
        check_report(outputs.report)

    def process(
        self,
        image: Path,
        detector: TreeDetector | None,
        rig: Rig,
        settings: MeasureSettings | None,
        pair: StereoPair | None = None,
    ) -> FrameResult:
        """Read the frame and measure the trees that the detector finds, or those of the mask."""
        from basetree.errors import InputError
        from edgetree.frames.images import read_masks
        from edgetree.frames.pipeline import measure_frame, process
        from edgetree.sources import open_source
        from edgetree.sources.folders import depth_alone
        from edgetree.sources.stereo import open_stereo

        takes_depth = detector is not None and detector.manifest.takes_depth
        has_depth = (self.distances or self.right or depth_alone(image)) is not None
        if not has_depth and not takes_depth and rig.references is None:
            raise InputError(
                "--depth is missing: expected the depth image to measure in, or without depth"
                " --camera-height, --marker or --scale-bar"
            )
        if pair is not None and self.right is not None:
            (frame,) = open_stereo(image, self.right, pair, rig=rig)
        else:
            depth_only = self.distances is None and (takes_depth or has_depth)
            (frame,) = open_source(image, self.distances, depth_only=depth_only, rig=rig)
        if frame.depth_fault is not None:
            raise InputError(frame.depth_fault)
        if detector is not None:
            return process(frame, detector, rig, settings)
        assert self.mask is not None
        picture = frame.depth_m if frame.image is None else frame.image
        assert picture is not None
        height, width = picture.shape[:2]
        return measure_frame(frame, read_masks(self.mask, (width, height)), rig, settings)


@dataclass(frozen=True)
class _Outputs:
    """The options for output files."""

    panel = RESULTS

    out: _Picture = None
    csv: Csv = None
    profiles: Profiles = None
    report: Report = None

    def write(
        self,
        result: FrameResult,
        source: str,
        trees_from: str,
        head: ReportHead,
        style: CsvStyle,
    ) -> None:
        """Write the picture, the tables and the report; if one fails, none is written."""
        from basetree.files.writing import replacing
        from edgetree.results.csv_table import PROFILES, TREES
        from edgetree.results.pictures import draw_frame, encode_picture
        from edgetree.sinks import CsvSink, ReportSink

        with ExitStack() as stack:
            if self.csv is not None:
                stack.enter_context(CsvSink(self.csv, TREES, style)).write(result)
            if self.profiles is not None:
                stack.enter_context(CsvSink(self.profiles, PROFILES, style)).write(result)
            if self.report is not None:
                report = ReportSink(self.report, source, trees_from, head=head)
                stack.enter_context(report).write(result)
            if self.out is not None:
                picture = stack.enter_context(replacing(self.out))
                picture.write(encode_picture(draw_frame(result), self.out.suffix.lower()))


@expand_groups
def measure(
    image: _Image,
    camera: _Camera = None,
    *,
    inputs: _Inputs,
    rig_options: RigOptions,
    outputs: _Outputs,
    csv_options: CsvOptions,
    report_options: ReportOptions,
    session: SessionOptions,
    shards: ShardOptions,
    as_json: Json = False,
) -> None:
    """Measure the trees of one image: diameter, DBH, cut height, lean and distance.

    Each value comes with its standard deviation, or the reason why it could not be measured.
    """
    from basetree.files.places import check_folders, check_paths
    from edgetree.commands.frame_results import kind_of_depth_words, note_files, unlike_words
    from edgetree.commands.other_model import better_result
    from edgetree.results.csv_table import measurements_of
    from edgetree.results.text_table import table_lines
    from edgetree.sources import model_for

    depth, mask, score_threshold = inputs.depth, inputs.mask, inputs.score_threshold
    if shards.are_given:
        inputs.check_shards()
    else:
        inputs.check(image, camera, rig_options, outputs)
        check_folders(vars(outputs).values())
    check_paths(
        {f"--{name}": path for name, path in vars(outputs).items()},
        {
            "source": image,
            "--depth": depth,
            "--right": inputs.right,
            "--cloud": inputs.cloud,
            "--model": model_file(inputs.model),
            "--mask": mask,
            **rig_options.files(camera),
        },
    )
    head = report_options.head(outputs.report)
    style = csv_options.style(outputs.csv, outputs.profiles)
    model = inputs.model or model_for(image, depth, inputs.right, inputs.cloud)
    if shards.are_given:
        csv_options.check_plain()
        work = ShardedFrames(image, depth, camera, model, rig_options, session, score_threshold)
        run_sharded(work, shards, vars(outputs), as_json=as_json)
        return
    keep_remarks()
    rig, pair = rig_options.rig_and_pair(camera, depth, "--right" if inputs.right else None)
    settings = rig_options.settings()
    opened = None if mask is not None else session.open_model(model, score_threshold)

    def process(detector: TreeDetector | None) -> FrameResult:
        return inputs.process(image, detector, rig, settings, pair)

    result, opinion = process(None if opened is None else opened[0]), None
    trees_from: dict[str, Any] = {"mask": str(mask)}
    trees_from_words = f"the mask {mask}"
    if opened is not None:
        result, opened, opinion = better_result(
            result, opened, session, process, may_replace=inputs.model is None
        )
        trees_from = {"model": model_record(*opened)}
        trees_from_words = f"the model {opened[1].name}"
    outputs.write(result, str(image), trees_from_words, head, style)
    if as_json:
        print_json(_record(result, image, inputs, outputs, trees_from))
    else:
        width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
        numbers, sizes = result.found.numbers, result.pixel_sizes
        for line in table_lines(measurements_of(result), numbers, sizes, width=width):
            tell(line)
    if opened is not None:
        note(model_words(*opened))
    alone = "" if result.trees.alone is None else str(result.trees.alone)
    depth_kind = kind_of_depth_words([result], rig)
    for line in filter(None, (opinion, alone, result.scaling, result.turning, depth_kind)):
        note(line)
    if result.trees.unlike is not None:
        words = unlike_words(result.frame.name, result.trees.unlike)
        note(f"unlike the training pictures: {words}")
    note_remarks()
    files = {"picture": outputs.out, "table": outputs.csv, "profiles": outputs.profiles}
    note_files({**files, "report": outputs.report})
    options = f"{quoted(image)}{rig_options.words(depth, camera)}{_words(inputs)}"
    stem = quoted(image.stem)
    if outputs.out is None:
        note(f"next: edgetree measure {options} --out {stem}_trees.jpg", whole=True)
    elif outputs.csv is None:
        note(f"next: edgetree measure {options} --csv {stem}_trees.csv", whole=True)
    else:
        options = f"{rig_options.words(None, camera)}{_words(inputs, kind_only=True)}"
        note(f"next: edgetree run FRAMES{options} --csv trees.csv", whole=True)


def _record(
    result: FrameResult,
    image: Path,
    inputs: _Inputs,
    outputs: _Outputs,
    trees_from: dict[str, Any],
) -> dict[str, Any]:
    """The JSON object of --json."""
    from edgetree.results import frame_record

    paths = {"picture": outputs.out, "csv": outputs.csv, "profiles": outputs.profiles}
    return {
        "schema": "edgetree.measure/1",
        **trees_from,
        "depth": None if result.frame.depth_m is None else str(inputs.distances or image),
        "camera": None if result.camera is None else result.camera.to_dict(),
        "frame": frame_record(result),
        **{name: None if path is None else str(path) for name, path in paths.items()},
    }


def _words(inputs: _Inputs, *, kind_only: bool = False) -> str:
    """The options about input and model, but for --depth, as typed on the command line.

    Args:
        inputs: The options.
        kind_only: Whether what names a file beside the image becomes a word for many of them.
    """
    given: dict[str, object] = {"right": inputs.right, "cloud": inputs.cloud}
    if kind_only:
        given = {name: f"{name.upper()}S" for name, value in given.items() if value}
        given |= {} if inputs.depth is None else {"depth": "DEPTHS"}
    given |= {"model": inputs.model, "mask": None if kind_only else inputs.mask}
    return "".join(f" --{name} {quoted(value)}" for name, value in given.items() if value)
