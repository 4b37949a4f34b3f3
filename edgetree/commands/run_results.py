"""The results of `edgetree run`: where they go, and what is said of them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from basetree.program.console import note, note_remarks
from basetree.program.quoting import quoted
from edgetree.commands.frame_results import (
    LeftOut,
    Totals,
    check_complete,
    frame_results,
    note_files,
    source_remarks,
)
from edgetree.commands.guarded_outputs import GuardedOutputs
from edgetree.commands.option_groups import RigOptions
from edgetree.commands.options import model_record, model_words
from edgetree.commands.other_model import OtherModel
from edgetree.commands.run_inputs import RunInputs
from edgetree.commands.run_outputs import RunOutputs
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FrameResult, process
from edgetree.frames.rig import Rig
from edgetree.live.results import numbered_stems
from edgetree.measure import MeasureSettings, StemViews
from edgetree.results.csv_style import CsvStyle
from edgetree.results.frame_line import frame_line
from edgetree.results.json_records import frame_record
from edgetree.runtime.detector import TreeDetector
from edgetree.sinks import JsonLinesSink, LinesSink
from edgetree.sources.opening import is_stream
from edgetree.sources.picture_names import is_image_name
from edgetree.sources.source import FrameSource
from edgetree.sources.source_list import SourceList
from edgetree.sources.videos import VideoFrames, is_picture

if TYPE_CHECKING:
    from edgetree.report import ReportHead

_FILES: Final = {
    "jsonl": "JSON lines",
    "csv": "table",
    "profiles": "profiles",
    "coco": "labels",
    "out": "pictures",
    "report": "report",
    "map": "map",
}


@dataclass
class RunResults:
    """Measures the frames, and hands the results to the outputs.

    Attributes:
        sources: Values of SOURCE.
        outputs: The options for output files.
        detector: The model.
        model_path: Its file.
        rig: The cameras.
        settings: Settings of the measurement; the defaults if None.
        totals: Counts over all frames.
        left_out: Frames that cannot be used.
        other: What another model would have found.
        guarded: The outputs.
        records: The frames of the object of --json.
    """

    sources: SourceList
    outputs: RunOutputs
    detector: TreeDetector
    model_path: Path
    rig: Rig
    settings: MeasureSettings | None
    totals: Totals
    left_out: LeftOut
    other: OtherModel
    guarded: GuardedOutputs
    records: list[dict[str, Any]] = field(default_factory=list)
    _views: StemViews = field(default_factory=StemViews)
    _views_of: Path | None = None

    def is_on_terminal(self, *, as_json: bool) -> bool:
        """Whether there is a line for each frame on a terminal."""
        return self.outputs.jsonl is None and not as_json and sys.stdout.isatty()

    def open_outputs(
        self, frames: FrameSource, head: ReportHead, style: CsvStyle, *, as_json: bool
    ) -> list[Callable[[FrameResult], object]]:
        """Open the outputs; returns what takes the results.

        Args:
            frames: The frames.
            head: Title, place and area of the report.
            style: How CSV tables are written.
            as_json: Whether one object is printed at the end.
        """
        record = lru_cache(maxsize=1)(frame_record)  # for a line and for the object of --json
        lines = self.outputs.jsonl or (None if as_json else sys.stdout)
        on_terminal = self.is_on_terminal(as_json=as_json)
        if lines is not None:
            given = self.outputs.jsonl
            self.guarded.open(
                "standard output" if given is None else f"--jsonl {given}",
                lambda: (
                    LinesSink(sys.stdout, frame_line)
                    if on_terminal
                    else JsonLinesSink(lines, record, grows=False)
                ),
            )
        rate_hz = frames.rate_hz if isinstance(frames, VideoFrames) else None
        about = (self.model_path.name, self.detector.score_threshold, self.left_out.reason_of_each)
        self.outputs.open(self.guarded, self.sources, *about, head, style, rate_hz)
        writes: list[Callable[[FrameResult], object]] = [self.totals.add, self.guarded.write]
        if as_json:
            writes.append(lambda result: self.records.append(record(result)))
        return writes

    def of(self, frames: FrameSource, *, shown: bool) -> Iterator[FrameResult]:
        """The results of frames; `shown` says whether there is a progress bar."""
        return frame_results(frames, self._measure, self.left_out, shown=shown)

    def _measure(self, frame: Frame) -> FrameResult:
        source = _source_of(frame)
        if source != self._views_of:  # its poses are in a frame of their own
            self._views, self._views_of = StemViews(), source
        result = process(frame, self.detector, self.rig, self.settings, self._views)
        self.other.look(result, lambda detector: process(frame, detector, self.rig, self.settings))
        stems = self.totals.stems
        return result if stems is None else numbered_stems(result, stems)


def _source_of(frame: Frame) -> Path | None:
    """The recording of a frame, or the folder of its picture; None of a camera."""
    path = frame.path
    return path.parent if path is not None and is_image_name(path) else path


def run_object(results: RunResults, *, is_interrupted: bool) -> dict[str, Any]:
    """The object of --json, of the schema edgetree.run/1."""
    sources, outputs, guarded = results.sources, results.outputs, results.guarded
    one, reasons = sources.one, results.left_out.reasons
    named = {"pictures": "out"} | {
        each: each for each in ("jsonl", "csv", "profiles", "coco", "report")
    }
    paths = {each: outputs.path_if(guarded, name) for each, name in named.items()}
    map_path = outputs.path_if(guarded, "map")
    return {
        "schema": "edgetree.run/1",
        "source": str(one or sources.name),
        **({} if one is not None else {"sources": [str(path) for path in sources.paths]}),
        "model": model_record(results.detector, results.model_path),
        "score_threshold": results.detector.score_threshold,
        "frames": results.records,
        **{name: None if path is None else str(path) for name, path in paths.items()},
        **({"map": str(map_path)} if map_path is not None else {}),
        **({"left_out": reasons} if reasons else {}),
        **({"incomplete": guarded.missing()} if guarded.missing() else {}),
        **({"interrupted": True} if is_interrupted else {}),
    }


def tell_results(results: RunResults, frames: FrameSource) -> None:
    """Say what was found, and where the files are."""
    words, outputs = model_words(results.detector, results.model_path), results.outputs
    said = (*results.totals.lines(), *source_remarks(frames), words, *results.other.lines())
    for line in said:
        note(line)
    note_remarks()
    is_video_out = outputs.out is not None and outputs.out.is_file()
    words_of = {**_FILES, **({"out": "video"} if is_video_out else {})}
    note_files({what: outputs.path_if(results.guarded, name) for name, what in words_of.items()})


def check_whole(results: RunResults, frames: FrameSource) -> None:
    """Raise CheckFailed if an output lacks results, a frame is left out or the source is broken."""
    results.guarded.check()
    results.left_out.check_none(results.totals.frames)
    check_complete(str(results.sources.one or results.sources.name), frames.counts)


def tell_next(results: RunResults, inputs: RunInputs, rig_options: RigOptions, model: str) -> None:
    """Say what may be run next."""
    one = results.sources.one
    options = f"{rig_options.words(inputs.depth, inputs.camera)}{inputs.words()}"
    takes_depth = inputs.depth is not None and results.detector.manifest.takes_depth
    images = inputs.depth if takes_depth else one
    typed = " ".join(map(quoted, results.sources.typed))
    if (further := results.outputs.further(one)) is not None:
        note(f"next: edgetree run {typed}{options} --model {quoted(model)} {further}", whole=True)
    elif one is not None and (is_picture(one) or (one.is_dir() and not is_stream(one))):
        note(f"next: edgetree bench {quoted(model)} --frames {quoted(images)}", whole=True)
