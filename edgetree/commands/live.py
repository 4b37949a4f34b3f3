"""`edgetree live`: follow the trees in front of a camera, or in a recording."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from basetree.program.console import note
from basetree.program.options import expand_groups
from basetree.program.setup_file import NoPath, naming_lines, take_setup
from basetree.program.talking import with_talk_options
from basetree.secrets import hide_secrets
from edgetree.commands.csv_options import CsvOptions
from edgetree.commands.live_options import (
    LiveMetresOptions,
    LivePageOptions,
    LiveSourceOptions,
    names_no_path,
    topics_by_role,
)
from edgetree.commands.live_outputs import LiveOutputs, LiveRecordOptions
from edgetree.commands.option_groups import SessionOptions
from edgetree.commands.options import (
    MODEL,
    ModelByInput,
    ScoreThreshold,
    check_distances,
    model_file,
    model_words,
)
from edgetree.sinks.mqtt_settings import MqttSettings

if TYPE_CHECKING:
    from calib.stereo import StereoPair
    from edgetree.frames.rig import Rig
    from edgetree.measure import MeasureSettings


def _read_setup(context: typer.Context, path: Path | None) -> Path | None:
    take_setup(context, path, live_command)
    return path


_Config: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        callback=_read_setup,
        is_eager=True,
        help="Set-up file (TOML) with any of these options; typed ones override it. See"
        " `edgetree config`.",
    ),
]
_Source: TypeAlias = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="A ROS 1 or ROS 2 bag or MCAP file; a video, a folder of images, a capture of a phone"
        " (.r3d, or the folder of Stray Scanner) or a simulated drive;"
        " a camera: a number, /dev/videoN, rtsp://..., http://..., realsense, oak or orbbec;"
        " clients, the programs that hand frames over at --serve.",
    ),
    NoPath(names_no_path),
]


@dataclass(frozen=True)
class ModelOptions:
    """The options about the model."""

    panel = MODEL

    model: ModelByInput = None
    score_threshold: ScoreThreshold = 0.5


@naming_lines
@expand_groups
def live(
    context: typer.Context,
    source: _Source,
    *,
    config: _Config = None,
    model_options: ModelOptions,
    metres: LiveMetresOptions,
    source_options: LiveSourceOptions,
    page_options: LivePageOptions,
    outputs: LiveOutputs,
    mqtt: MqttSettings,
    csv_options: CsvOptions,
    record_options: LiveRecordOptions,
    session: SessionOptions,
) -> None:
    """Find, measure and follow the trees in front of a camera, or in a recording.

    Stems keep their number from frame to frame, and all views of a stem are combined into one
    diameter with its interval. Prints a line per frame: a short one on a terminal, into files and
    pipes one JSON object. Ctrl-C, SIGTERM and SIGHUP end it with everything written. Files of an
    earlier run are kept under another name.
    """
    from basetree.files.places import check_folders
    from edgetree.commands.frame_results import check_complete, warnings_shown
    from edgetree.commands.guarded_outputs import GuardedOutputs
    from edgetree.commands.live_run import LiveRun, LiveSource
    from edgetree.live.health import ServiceHealth
    from edgetree.live.pipeline import LivePipeline
    from edgetree.live.recording import run_record

    shown = hide_secrets(source)
    score_threshold = model_options.score_threshold
    model, rig, settings, pair = checked_set_up(
        source, model_options.model, metres, source_options, outputs, mqtt, record_options
    )
    check_folders((outputs.jsonl, outputs.csv, outputs.map, outputs.report), [outputs.bag])
    style = csv_options.style(outputs.csv)
    page_options.check_service(source)
    tracker = metres.tracker()
    detector, model_path = session.open_model(model, score_threshold)
    takes_depth = detector.manifest.takes_depth
    others = (record_options.record, page_options.page, page_options.serve)
    guarded = GuardedOutputs(others=any(others))
    record = partial(
        run_record,
        model_path,
        source=shown,
        score_threshold=score_threshold,
        rig=rig,
        settings=settings,
    )
    with (
        warnings_shown(),
        record_options.recording(record) as recorder,
        page_options.listening(source) as service,
        ExitStack() as stack,
    ):
        opening = LiveSource(source, source_options, rig, takes_depth, service, recorder, pair)
        pipeline = LivePipeline(
            opening,
            detector,
            rig=rig,
            settings=settings,
            tracker=tracker,
            on_unused=None if service is None else service.unused,
        )
        if service is not None:
            service.status_of = lambda: pipeline.status
        health = ServiceHealth(lambda: pipeline.status, model_path.name, guarded.lacking)
        waits = bool(outputs.are_given or page_options.serve)
        page = stack.enter_context(page_options.serving(recorder, health, waits=waits))
        run = LiveRun(
            pipeline,
            opening,
            guarded,
            outputs,
            not (outputs.jsonl or page_options.page or page_options.serve),
            shown,
            model_path.name,
            style,
            recorder,
            service,
            page,
        )
        try:
            run.follow(health, mqtt)
        except KeyboardInterrupt:
            run.tell_end()
            run.tell_files()
            raise
        run.tell_end()
        note(model_words(detector, model_path))
        run.tell_files()
    guarded.check()
    check_complete(shown, pipeline.status.remarks)


live_command = with_talk_options(live)
"""The command with all the options that it has on the command line, for its set-up file."""


def checked_set_up(
    source: str,
    model: str | None,
    metres: LiveMetresOptions,
    source_options: LiveSourceOptions,
    outputs: LiveOutputs,
    mqtt: MqttSettings,
    record_options: LiveRecordOptions,
) -> tuple[str, Rig, MeasureSettings | None, StereoPair | None]:
    """Check what can be checked before anything is opened.

    Returns model, rig, settings, and the calibration of the two cameras of a recording.

    The model is the one that suits the source, if none is given.

    Raises:
        InputError: Options contradict each other, a value is wrong, or a file cannot be read.
    """
    from basetree.files.places import check_paths
    from edgetree.catalogue import suited_model

    rig_options = metres.as_rig_options()
    check_paths(
        outputs.paths | {"--record": record_options.record},
        {
            "source": Path(source),
            "--depth": source_options.depth,
            "--right": source_options.right,
            "--model": model_file(model),
            **rig_options.files(metres.camera),
        },
    )
    topics_by_role(source_options.topic)
    outputs.check(mqtt)
    has_depth = source_options.has_depth(source)
    without_depth = rig_options.references() is not None
    if source_options.right is not None:
        check_distances(
            source_options.depth, source_options.right, None, without_depth=without_depth
        )
    outputs.check_places(source, has_depth=has_depth or without_depth)
    rig, pair = rig_options.rig_and_pair(
        metres.camera, source_options.depth, source_options.right_given
    )
    source_options.check(source, rig)
    record_options.check()
    return model or suited_model(has_depth), rig, rig_options.settings(), pair
