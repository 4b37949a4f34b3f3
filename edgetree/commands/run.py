"""`edgetree run`: detect and measure the trees of images, a video, a recording or a drive."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from basetree.program.console import keep_remarks, note, note_remarks, print_json
from basetree.program.options import expand_groups
from edgetree.commands.csv_options import CsvOptions
from edgetree.commands.option_groups import ReportOptions, RigOptions, SessionOptions
from edgetree.commands.options import (
    Json,
    ScoreThreshold,
    model_record,
    model_words,
    quoted,
)
from edgetree.commands.run_checks import check_options
from edgetree.commands.run_inputs import RunInputs, Source
from edgetree.commands.run_outputs import RunOutputs
from edgetree.commands.sharding import ShardedFrames, ShardOptions, run_sharded

if TYPE_CHECKING:
    from edgetree.frames.frame import Frame
    from edgetree.frames.pipeline import FrameResult

_FILES: Final = {
    "jsonl": "JSON lines",
    "csv": "table",
    "profiles": "profiles",
    "coco": "labels",
    "out": "pictures",
    "report": "report",
    "map": "map",
}


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
    rig, pair = rig_options.rig_and_pair(inputs.camera, inputs.depth, inputs.right)
    settings = rig_options.settings()
    are_files = one is None or (one.is_dir() and not is_stream(one))
    is_followed = one is not None and (is_stream(one) or is_video(one))
    are_pictures = not any(is_stream(path) or is_video(path) for path in sources.paths)
    stems = PictureTracker() if is_followed else None
    totals = Totals(rig, stems=stems, are_pictures=are_pictures)
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
    note_remarks()
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
