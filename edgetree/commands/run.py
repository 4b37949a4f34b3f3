"""`edgetree run`: detect and measure the trees of images, a video, a recording or a drive."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import typer

from basetree.program.console import note, print_json
from basetree.program.options import expand_groups
from edgetree.commands.csv_options import CsvOptions
from edgetree.commands.live_options import Scene, Topic, topics_by_role
from edgetree.commands.option_groups import ReportOptions, RigOptions, SessionOptions
from edgetree.commands.options import (
    INPUT,
    RESULTS,
    Camera,
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
    quoted,
)
from edgetree.commands.sharding import ShardedFrames, ShardOptions, run_sharded

if TYPE_CHECKING:
    from calib.stereo import StereoPair
    from edgetree.commands.guarded_outputs import GuardedOutputs
    from edgetree.frames.frame import Frame
    from edgetree.frames.pipeline import FrameResult
    from edgetree.frames.rig import Rig
    from edgetree.report import ReportHead
    from edgetree.results.csv_style import CsvStyle
    from edgetree.runtime.detector import TreeDetector
    from edgetree.sinks import FileSink
    from edgetree.sources.source import FrameSource
    from edgetree.sources.source_list import SourceList

_Source: TypeAlias = Annotated[
    list[Path],
    typer.Argument(
        metavar="SOURCE...",
        help="An image, a folder of images, a video, a point cloud (seen by virtual cameras all"
        " around), a ROS bag or MCAP file, a capture of a phone (.r3d, or the folder of Stray"
        " Scanner), or a simulated drive; or several of them, or patterns such as 'plot*/*.jpg';"
        " with --shards a folder or URL of images or of recordings.",
    ),
]
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
_Recursive: TypeAlias = Annotated[
    bool,
    typer.Option("--recursive", help="Take the pictures of the folders below each folder too."),
]
_StrictFrames: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--strict-frames",
        help="Stop at the first frame of a folder that cannot be read or measured, with exit code"
        " 2 and only the pictures so far. Otherwise such frames are left out, with exit code 1.",
    ),
]
_Map: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Map of the stems of a recording or drive with poses, .geojson or .gpkg, in metres.",
    ),
]

_FILES: Final = {
    "jsonl": "JSON lines",
    "csv": "table",
    "profiles": "profiles",
    "coco": "labels",
    "out": "pictures",
    "report": "report",
    "map": "map",
}


@dataclass(frozen=True)
class _Inputs:
    """The options that say what to detect in, and with what."""

    panel = INPUT

    model: ModelByInput = None
    depth: Depth = None
    right: Right = None
    cloud: Cloud = None
    camera: Camera = None
    topic: Topic = None
    scene: Scene = None
    recursive: _Recursive = False
    strict_frames: _StrictFrames = False

    def open(
        self, sources: SourceList, rig: Rig, pair: StereoPair | None, detector: TreeDetector
    ) -> FrameSource:
        """Open the frames."""
        from edgetree.sources.opening import open_frames
        from edgetree.sources.several import open_several
        from edgetree.sources.stereo import open_stereo

        source = sources.one
        if source is not None and pair is not None and self.right is not None:
            return open_stereo(source, self.right, pair, rig=rig)

        def opened(path: Path) -> FrameSource:
            return open_frames(
                path,
                self.depth or self.cloud,
                rig=rig,
                detector=detector,
                topics=topics_by_role(self.topic),
                scene=self.scene,
            )

        if source is not None:
            return opened(source)
        takes_depth = detector.manifest.takes_depth
        depth = self.depth or self.cloud
        return open_several(sources, depth, rig=rig, open_one=opened, takes_depth=takes_depth)

    def sees_depth(self, sources: SourceList) -> bool:
        """Whether depth is given or comes with the sources, so that a model for depth suits."""
        if any(given is not None for given in (self.depth, self.right, self.cloud)):
            return True
        return sources.has_depth(topics_by_role(self.topic))

    def words(self) -> str:
        """The options about streams as they would be typed on the command line."""
        given = [("topic", name) for name in self.topic or ()]
        given += [] if self.right is None else [("right", str(self.right))]
        given += [] if self.cloud is None else [("cloud", str(self.cloud))]
        given += [] if self.scene is None else [("scene", str(self.scene))]
        words = "".join(f" --{name} {quoted(value)}" for name, value in given)
        return words + " --recursive" * self.recursive


@dataclass(frozen=True)
class _Outputs:
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
            reasons: Why frames are left out, for the report.
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


@expand_groups
def run(
    source: _Source,
    *,
    inputs: _Inputs,
    rig_options: RigOptions,
    outputs: _Outputs,
    csv_options: CsvOptions,
    report_options: ReportOptions,
    score_threshold: ScoreThreshold = 0.5,
    session: SessionOptions,
    shards: ShardOptions,
    as_json: Json = False,
) -> None:
    """Detect the trees of images, a video, a recording or a simulated drive.

    Prints a line per frame: a short one on a terminal; into files and pipes one JSON object with
    boxes, masks (COCO RLE) and keypoints in pixels, and with depth and a camera the measurements of
    each tree in metres. Ctrl-C, SIGTERM and SIGHUP keep the results so far.
    """
    from edgetree.catalogue import suited_model
    from edgetree.commands.frame_results import (
        LeftOut,
        Totals,
        check_complete,
        frame_results,
        note_files,
        source_remarks,
        warnings_shown,
    )
    from edgetree.commands.guarded_outputs import GuardedOutputs
    from edgetree.commands.other_model import OtherModel
    from edgetree.frames.pipeline import process
    from edgetree.live.results import numbered_stems
    from edgetree.live.tracking.picture_tracker import PictureTracker
    from edgetree.measure import StemViews
    from edgetree.results.frame_line import frame_line
    from edgetree.results.json_records import frame_record
    from edgetree.sinks import JsonLinesSink, LinesSink
    from edgetree.sources.opening import is_stream
    from edgetree.sources.source_list import list_sources
    from edgetree.sources.videos import VideoFrames, is_picture, is_video

    sources = list_sources(source, recursive=inputs.recursive)
    one = sources.one
    _check(sources, inputs, rig_options, outputs, shards)
    head = report_options.head(outputs.report)
    style = csv_options.style(outputs.csv, outputs.profiles)
    model = inputs.model or suited_model(inputs.sees_depth(sources))
    if shards.are_given:
        assert one is not None
        csv_options.check_plain()
        given = (inputs.depth, inputs.camera, model, rig_options, session, score_threshold)
        run_sharded(ShardedFrames(one, *given), shards, vars(outputs), as_json=as_json)
        return
    detector, model_path = session.open_model(model, score_threshold)
    rig, pair = rig_options.rig_and_pair(inputs.camera, inputs.depth, inputs.right)
    settings = rig_options.settings()
    are_files = one is None or (one.is_dir() and not is_stream(one))
    is_followed = one is not None and (is_stream(one) or is_video(one))
    stems = PictureTracker() if is_followed else None
    totals = Totals(rig, stems=stems)
    left_out = LeftOut(inputs.strict_frames or not are_files)
    other = OtherModel(detector, session)
    records: list[dict[str, Any]] = []
    record = lru_cache(maxsize=1)(frame_record)  # for a line and for the object of --json
    lines = outputs.jsonl or (None if as_json else sys.stdout)
    on_terminal = lines == sys.stdout and sys.stdout.isatty()
    guarded = GuardedOutputs(others=as_json)
    with warnings_shown(), guarded:
        frames = inputs.open(sources, rig, pair, detector)
        writes: list[Callable[[FrameResult], object]] = [totals.add, guarded.write]
        if lines is not None:
            name = "standard output" if outputs.jsonl is None else f"--jsonl {outputs.jsonl}"
            guarded.open(
                name,
                lambda: (
                    LinesSink(sys.stdout, frame_line)
                    if on_terminal
                    else JsonLinesSink(lines, record, grows=False)
                ),
            )
        rate_hz = frames.rate_hz if isinstance(frames, VideoFrames) else None
        about = (model_path.name, score_threshold, left_out.reasons, head, style, rate_hz)
        outputs.open(guarded, sources, *about)
        if as_json:
            writes.append(lambda result: records.append(record(result)))

        views = StemViews()

        def measure(frame: Frame) -> FrameResult:
            result = process(frame, detector, rig, settings, views)
            other.look(result, lambda detector: process(frame, detector, rig, settings))
            return result if stems is None else numbered_stems(result, stems)

        results = frame_results(frames, measure, left_out, shown=not on_terminal)
        is_interrupted = _write_all(results, writes)
        left_out.check_some(totals.frames)
    if as_json:
        named = {"pictures": "out"} | {each: each for each in ("jsonl", "csv", "profiles", "coco")}
        paths = {each: outputs.path_if(guarded, name) for each, name in named.items()}
        print_json(
            {
                "schema": "edgetree.run/1",
                "source": str(one or sources.name),
                **({} if one is not None else {"sources": [str(path) for path in sources.paths]}),
                "model": model_record(detector, model_path),
                "score_threshold": detector.score_threshold,
                "frames": records,
                **{name: None if path is None else str(path) for name, path in paths.items()},
                **({} if outputs.map is None else {"map": str(outputs.map)}),
                **({"left_out": left_out.reasons} if left_out.reasons else {}),
                **({"incomplete": guarded.missing()} if guarded.missing() else {}),
                **({"interrupted": True} if is_interrupted else {}),
            }
        )
    words = model_words(detector, model_path)
    for line in (*totals.lines(), *source_remarks(frames), words, *other.lines()):
        note(line)
    is_video_out = outputs.out is not None and outputs.out.is_file()
    words_of = {**_FILES, **({"out": "video"} if is_video_out else {})}
    note_files({words: outputs.path_if(guarded, name) for name, words in words_of.items()})
    for line in guarded.missing() if is_interrupted else ():
        note(line)
    if is_interrupted:
        raise KeyboardInterrupt
    guarded.check()
    left_out.check_none(totals.frames)
    check_complete(str(one or sources.name), frames.counts)
    options = f"{rig_options.words(inputs.depth, inputs.camera)}{inputs.words()}"
    takes_depth = inputs.depth is not None and detector.manifest.takes_depth
    images = inputs.depth if takes_depth else one
    typed = " ".join(map(quoted, sources.typed))
    if (further := outputs.further(one)) is not None:
        note(f"next: edgetree run {typed}{options} --model {quoted(model)} {further}", whole=True)
    elif one is not None and (are_files or is_picture(one)):
        note(f"next: edgetree bench {quoted(model)} --frames {quoted(images)}", whole=True)


def _write_all(
    results: Iterable[FrameResult], writes: Sequence[Callable[[FrameResult], object]]
) -> bool:
    """Write all results, each of them whole; returns whether an interrupt came after the first."""
    from basetree.program.interrupts import interrupt_afterwards

    is_begun = False
    try:
        for result in results:
            with interrupt_afterwards():
                is_begun = True
                for write in writes:
                    write(result)
    except KeyboardInterrupt:
        if not is_begun:
            raise
        return True
    return False


def _check(
    sources: SourceList,
    inputs: _Inputs,
    rig_options: RigOptions,
    outputs: _Outputs,
    shards: ShardOptions,
) -> None:
    """Raise InputError if outputs overwrite files or do not fit the source."""
    from basetree.errors import InputError
    from basetree.files.writing import check_paths
    from edgetree.sources.drive import is_drive
    from edgetree.sources.opening import is_stream
    from edgetree.sources.videos import is_video, is_video_name

    check_paths(
        {f"--{name}": path for name, path in vars(outputs).items()},
        {
            **sources.by_name(),
            "--depth": inputs.depth,
            "--right": inputs.right,
            "--cloud": inputs.cloud,
            "--model": model_file(inputs.model),
            **rig_options.files(inputs.camera),
        },
    )
    check_report(outputs.report)
    without_depth = rig_options.references() is not None
    check_distances(inputs.depth, inputs.right, inputs.cloud, without_depth=without_depth)
    for source in sources.paths:
        if not is_stream(source):
            check_extrinsic(
                rig_options.extrinsic, source if source.is_file() else None, inputs.cloud
            )
        if outputs.coco and is_video(source):
            raise InputError(f"source {source} is a video: expected images, as --coco is given")
        if outputs.coco and is_stream(source) and not is_drive(source):
            raise InputError(f"source {source} is a recording: expected images, as --coco is given")
        if outputs.map and not (shards.are_given or is_stream(source)):
            raise InputError(
                f"source {source} has no poses: expected a recording or a drive with poses, as"
                " --map is given; `edgetree live` follows stems without them, with depth or"
                " --camera-height"
            )
    if shards.are_given and inputs.words():
        raise InputError(f"{inputs.words().split()[0]} given with --shards: expected one of them")
    one = sources.one
    is_in_order = one is not None and (is_video(one) or is_stream(one))
    if outputs.out and is_video_name(outputs.out) and not is_in_order:
        raise InputError(
            f"--out is {outputs.out} and source {sources.name} has pictures in no order: expected a"
            " folder, or a video or recording to draw a video of"
        )
    if one is None:
        _check_several(sources, inputs, outputs, shards)


def _check_several(
    sources: SourceList, inputs: _Inputs, outputs: _Outputs, shards: ShardOptions
) -> None:
    """Raise InputError if an option is given that is for one source."""
    from basetree.errors import InputError

    given = {
        "--right": inputs.right is not None,
        "--map": outputs.map is not None,
        "--scene": inputs.scene is not None,
        "--shards": shards.are_given,
    }
    for option, is_given in given.items():
        if is_given:
            raise InputError(
                f"{option} given with {len(sources.paths)} sources: expected one source"
            )
