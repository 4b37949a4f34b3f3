"""`edgetree run`: detect and measure the trees of images, a video, a recording or a drive."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from basetree.program.console import keep_remarks, note, print_json
from basetree.program.options import expand_groups
from edgetree.commands.csv_options import CsvOptions
from edgetree.commands.option_groups import ReportOptions, RigOptions, SessionOptions
from edgetree.commands.options import Json, ScoreThreshold
from edgetree.commands.run_checks import check_options
from edgetree.commands.run_inputs import RunInputs, Source
from edgetree.commands.run_outputs import RunOutputs
from edgetree.commands.sharding import ShardedFrames, ShardOptions, run_sharded

if TYPE_CHECKING:
    from edgetree.frames.pipeline import FrameResult


@expand_groups
def run(
    source: Source,
    *,
    inputs: RunInputs,
    rig_options: RigOptions,
    outputs: RunOutputs,
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
    from edgetree.commands.frame_results import LeftOut, Totals, source_remarks, warnings_shown
    from edgetree.commands.guarded_outputs import GuardedOutputs
    from edgetree.commands.other_model import OtherModel
    from edgetree.commands.run_results import (
        RunResults,
        check_whole,
        run_object,
        tell_next,
        tell_results,
    )
    from edgetree.live.tracking.picture_tracker import PictureTracker
    from edgetree.sources.opening import is_stream
    from edgetree.sources.source_list import list_sources
    from edgetree.sources.videos import is_video

    keep_remarks()
    sources = list_sources(source, recursive=inputs.recursive)
    one = sources.one
    check_options(sources, inputs, rig_options, outputs, shards)
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
    rig, pair = rig_options.rig_and_pair(inputs.camera, inputs.depth, inputs.right_given)
    are_files = one is None or (one.is_dir() and not is_stream(one))
    is_followed = one is not None and (is_stream(one) or is_video(one))
    are_pictures = not any(is_stream(path) or is_video(path) for path in sources.paths)
    stems = PictureTracker() if is_followed else None
    results = RunResults(
        sources,
        outputs,
        detector,
        model_path,
        rig,
        rig_options.settings(),
        Totals(rig, stems=stems, are_pictures=are_pictures),
        LeftOut(inputs.strict_frames or not are_files),
        OtherModel(detector, session),
        GuardedOutputs(others=as_json),
    )
    with warnings_shown(), results.guarded:
        frames = inputs.open(sources, rig, pair, detector)
        writes = results.open_outputs(frames, head, style, as_json=as_json)
        shown = not results.is_on_terminal(as_json=as_json)
        is_interrupted = _write_all(results.of(frames, shown=shown), writes)
        if not is_interrupted:
            if not results.totals.frames:
                for line in source_remarks(frames):
                    note(line)
            results.left_out.check_some(results.totals.frames)
    if as_json:
        print_json(run_object(results, is_interrupted=is_interrupted))
    tell_results(results, frames)
    if is_interrupted:
        for line in results.guarded.missing():
            note(line)
        raise KeyboardInterrupt
    check_whole(results, frames)
    tell_next(results, inputs, rig_options, model)


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
