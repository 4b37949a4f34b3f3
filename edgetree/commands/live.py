"""`edgetree live`: follow the trees in front of a camera, or in a recording."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import typer

from basetree.program.console import note
from basetree.program.options import expand_groups
from edgetree.commands.live_options import (
    LiveMetresOptions,
    LivePageOptions,
    LiveSourceOptions,
)
from edgetree.commands.live_outputs import LiveOutputs, LiveRecordOptions
from edgetree.commands.option_groups import SessionOptions
from edgetree.commands.options import MODEL, Model, ScoreThreshold, model_file, model_words

if TYPE_CHECKING:
    from edgetree.live.pipeline import LivePipeline
    from edgetree.live.results import LiveResult
    from edgetree.sources.source import FrameSource

_STATUS_EVERY_S: Final = 5.0

_Write: TypeAlias = "Callable[[LiveResult], object]"

_Source: TypeAlias = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="A ROS 1 or ROS 2 bag or MCAP file; a video, a folder of images, a capture of a phone"
        " (.r3d, or the folder of Stray Scanner) or a simulated drive;"
        " a camera: a number, /dev/videoN, rtsp://..., http://..., realsense, oak or orbbec.",
    ),
]


@dataclass(frozen=True)
class _ModelOptions:
    """The options about the model."""

    panel = MODEL

    model: Model = "depth"
    score_threshold: ScoreThreshold = 0.5


@expand_groups
def live(
    source: _Source,
    *,
    model_options: _ModelOptions,
    metres: LiveMetresOptions,
    source_options: LiveSourceOptions,
    page_options: LivePageOptions,
    outputs: LiveOutputs,
    record_options: LiveRecordOptions,
    session: SessionOptions,
) -> None:
    """Find, measure and follow the trees in front of a camera, or in a recording.

    Stems keep their number from frame to frame, and all views of a stem are combined into one
    diameter with its interval. Prints a line per frame: a short one on a terminal, into files and
    pipes one JSON object. Ctrl-C, SIGTERM and SIGHUP end it with everything written. Files of an
    earlier run are kept under another name.
    """
    from basetree.files.writing import check_paths
    from edgetree.commands.frame_results import check_complete, warnings_shown
    from edgetree.commands.guarded_outputs import GuardedOutputs
    from edgetree.live.pipeline import LivePipeline
    from edgetree.live.recording import run_record

    model, score_threshold = model_options.model, model_options.score_threshold
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
    outputs.origin()  # a wrong value ends the command here
    rig, settings = rig_options.rig(metres.camera, None), rig_options.settings()
    tracker = metres.tracker()
    detector, model_path = session.open_model(model, score_threshold)
    takes_depth = detector.manifest.takes_depth
    to_stdout = not (outputs.jsonl or page_options.page)
    with (
        warnings_shown(),
        record_options.recording(
            lambda: run_record(
                model_path,
                source=source,
                score_threshold=score_threshold,
                rig=rig,
                settings=settings,
            ),
        ) as recorder,
        page_options.serving(recorder) as page,
    ):

        def open_source() -> FrameSource:
            opened = source_options.open(source, rig, takes_depth)
            if recorder is not None:
                recorder.wait_for_disk(waits=not opened.is_live)
            return opened

        pipeline = LivePipeline(open_source, detector, rig=rig, settings=settings, tracker=tracker)
        guarded = GuardedOutputs(others=recorder is not None or page is not None)

        def open_outputs() -> list[_Write]:
            outputs.open(guarded, to_stdout, source, model_path.name)
            writes: list[_Write] = [guarded.write]
            writes += [] if recorder is None else [recorder.write]
            return writes if page is None else [*writes, page.publish]

        def told() -> str:
            recordings = [] if recorder is None else [recorder.status.line()]
            return ", ".join([pipeline.status.line(), *recordings, *guarded.missing()])

        try:
            with closing(guarded):
                _follow(pipeline, open_outputs, told, outputs.frames)
        except KeyboardInterrupt:
            for line in guarded.missing():
                note(line)
            raise
        note(pipeline.status.line())
        note(model_words(detector, model_path))
    guarded.check()
    check_complete(source, pipeline.status.remarks)


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
