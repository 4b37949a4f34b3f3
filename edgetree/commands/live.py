"""`edgetree live`: follow the trees in front of a camera, or in a recording."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

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
    model_file,
    model_words,
)
from edgetree.sinks.mqtt_settings import MqttSettings

if TYPE_CHECKING:
    from edgetree.frames.rig import Rig
    from edgetree.live.pipeline import LivePipeline
    from edgetree.live.results import LiveResult
    from edgetree.measure import MeasureSettings
    from edgetree.sources.source import FrameSource

_STATUS_EVERY_S: Final = 5.0

_Write: TypeAlias = "Callable[[LiveResult], object]"


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
    from basetree.errors import EdgetreeError, InputError
    from edgetree.commands.frame_results import check_complete, different_words, warnings_shown
    from edgetree.commands.guarded_outputs import GuardedOutputs
    from edgetree.live.health import ServiceHealth, StateReporter
    from edgetree.live.pipeline import LivePipeline
    from edgetree.live.recording import run_record
    from edgetree.measure.estimates import Failure

    shown = hide_secrets(source)
    score_threshold = model_options.score_threshold
    model, rig, settings = checked_set_up(
        source, model_options.model, metres, source_options, outputs, mqtt, record_options
    )
    style = csv_options.style(outputs.csv)
    page_options.check_service(source)
    tracker = metres.tracker()
    detector, model_path = session.open_model(model, score_threshold)
    takes_depth = detector.manifest.takes_depth
    to_stdout = not (outputs.jsonl or page_options.page or page_options.serve)
    others = (record_options.record, page_options.page, page_options.serve)
    guarded = GuardedOutputs(others=any(others))
    with (
        warnings_shown(),
        record_options.recording(
            lambda: run_record(
                model_path,
                source=shown,
                score_threshold=score_threshold,
                rig=rig,
                settings=settings,
            ),
        ) as recorder,
        page_options.listening(source) as service,
        ExitStack() as stack,
    ):
        is_live = is_open = False

        def open_source() -> FrameSource:
            nonlocal is_live
            opened = source_options.open(source, rig, takes_depth, service)
            is_live = opened.is_live
            if recorder is not None:
                recorder.wait_for_disk(waits=not is_live)
            return opened

        pipeline = LivePipeline(
            open_source,
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

        def open_outputs() -> list[_Write]:
            nonlocal is_open
            outputs.open_files(
                guarded, shown, model_path.name, style, to_stdout=to_stdout, states=is_live
            )
            is_open = True
            writes: list[_Write] = [guarded.write]
            writes += [] if recorder is None else [recorder.write]
            writes += [] if service is None else [service.write]
            return writes if page is None else [*writes, page.publish]

        def told() -> str:
            recordings = [] if recorder is None else [recorder.status.line()]
            return ", ".join([pipeline.status.line(), *recordings, *guarded.missing()])

        try:
            with closing(guarded):
                outputs.open_controllers(guarded, mqtt)
                with StateReporter(health, guarded.tell):
                    _follow(pipeline, open_outputs, told, outputs.frames)
        except KeyboardInterrupt:
            for line in guarded.missing():
                note(line)
            raise
        except (InputError, OSError) as error:
            if not is_open or isinstance(error, BrokenPipeError):
                raise
            # A set-up that gave results is not wrong: the exit code lets a supervisor start again.
            raise EdgetreeError(str(error)) from error
        note(pipeline.status.line())
        if pipeline.in_picture is not None and pipeline.in_picture.frames > 1:
            found = pipeline.in_picture.different()
            note(
                f"trees not counted: {found.reason}"
                if isinstance(found, Failure)
                else different_words(found)
            )
        note(model_words(detector, model_path))
        _tell_files(outputs)
    guarded.check()
    check_complete(shown, pipeline.status.remarks)


live_command = with_talk_options(live)
"""The command with all the options that it has on the command line, for its set-up file."""


def _tell_files(outputs: LiveOutputs) -> None:
    """Say where the results are."""
    for option, path in outputs.paths.items():
        if path.exists():
            note(f"{'table' if option == '--csv' else option.removeprefix('--')}: {path}")


def checked_set_up(
    source: str,
    model: str | None,
    metres: LiveMetresOptions,
    source_options: LiveSourceOptions,
    outputs: LiveOutputs,
    mqtt: MqttSettings,
    record_options: LiveRecordOptions,
) -> tuple[str, Rig, MeasureSettings | None]:
    """Check what can be checked before anything is opened; returns model, rig and settings.

    The model is the one that suits the source, if none is given.

    Raises:
        InputError: Options contradict each other, a value is wrong, or a file cannot be read.
    """
    from basetree.files.writing import check_paths
    from edgetree.catalogue import suited_model

    rig_options = metres.as_rig_options()
    check_paths(
        outputs.paths | {"--record": record_options.record},
        {
            "source": Path(source),
            "--depth": source_options.depth,
            "--model": model_file(model),
            **rig_options.files(metres.camera),
        },
    )
    topics_by_role(source_options.topic)
    outputs.check(mqtt)
    has_depth = source_options.has_depth(source)
    outputs.check_places(source, has_depth=has_depth or rig_options.references() is not None)
    rig, settings = rig_options.rig(metres.camera, None), rig_options.settings()
    source_options.check(source, rig)
    record_options.check()
    return model or suited_model(has_depth), rig, settings


def _follow(
    pipeline: LivePipeline,
    open_outputs: Callable[[], list[_Write]],
    told: Callable[[], str],
    most: int | None,
) -> None:
    """Hand each result to all outputs, and say every few seconds how it goes.

    The outputs are opened with the first result, so that a source without any replaces no file.

    Args:
        pipeline: Gives the results.
        open_outputs: Opens the outputs; returns what takes the results.
        told: How it goes, as a line.
        most: Number of results to end after; None for all.
    """
    from basetree.errors import InputError
    from basetree.program.interrupts import interrupt_afterwards

    writes: list[_Write] = []
    said_s = time.monotonic()
    with closing(iter(pipeline)) as results:
        number = 0
        for number, result in enumerate(results, 1):
            with interrupt_afterwards():
                writes = writes or open_outputs()
                for write in writes:
                    write(result)
                if time.monotonic() - said_s > _STATUS_EVERY_S:
                    note(told())
                    said_s = time.monotonic()
            if number == most:
                break
        else:
            if number == 0:
                raise InputError(f"{pipeline.status.line()}: expected a frame that can be used")
