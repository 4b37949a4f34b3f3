"""The results of a source's frames, one after the other, and what is said about all of them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from basetree.counts import counted
from basetree.errors import CheckFailed, InputError, short_line
from basetree.program.console import LogNotes, complain, note
from basetree.program.progress import track
from calib.depth.range_check import RangeExponent, kind_words
from edgetree.detections import UnlikeTraining
from edgetree.frames.depth_kind import ground_exponents
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FrameResult
from edgetree.frames.rig import Rig
from edgetree.live.tracking.picture_tracker import PictureTracker
from edgetree.measure import Estimate, Failure
from edgetree.sources.source import INCOMPLETE, REMARKS, FrameSource, readable

_FRAMES_CHECKED: Final = 20  # for the kind of their depth, which is that of all frames


def frame_results(
    frames: FrameSource, process: Callable[[Frame], FrameResult], left_out: LeftOut, *, shown: bool
) -> Iterator[FrameResult]:
    """Process frames with a progress bar.

    Args:
        frames: The frames.
        process: Detects and measures the trees of a frame.
        left_out: Takes the frames that cannot be read or processed.
        shown: Whether to show the progress bar on a terminal.
    """
    for frame in track(readable(frames, left_out.add), "detecting", frames.count, shown=shown):
        try:
            result = process(frame)
        except InputError as error:
            left_out.add(error)
            continue
        yield result


class LeftOut:
    """The frames that cannot be read or measured.

    Args:
        strict: Whether the first one ends the command.

    Attributes:
        reasons: What the errors say, on one line each; equal ones once.
        reason_of_each: The reason of each frame, so that equal ones are there as often as frames.
    """

    def __init__(self, strict: bool) -> None:
        self._strict = strict
        self.reasons: list[str] = []
        self.reason_of_each: list[str] = []

    @property
    def count(self) -> int:
        """Number of the frames."""
        return len(self.reason_of_each)

    def add_once(self, error: Exception) -> None:
        """Do as `add`, but for a frame of which the same was told before."""
        if _reason(error) not in self.reasons:
            self.add(error)

    def add(self, error: Exception) -> None:
        """Leave out a frame and say why, once; with `strict`, raise the error instead."""
        if self._strict:
            raise error
        reason = _reason(error)
        self.reason_of_each.append(reason)
        if reason not in self.reasons:
            self.reasons.append(reason)
            complain(f"left out: {reason}")

    def check_some(self, results: int) -> None:
        """Raise InputError if there is no result."""
        if results:
            return
        found = "there is no frame"
        if self.count:
            found = f"all {counted(self.count, 'frame')} left out"
        raise InputError(f"{found}: expected one that can be read and measured")

    def check_none(self, results: int) -> None:
        """Raise CheckFailed if a frame is left out."""
        if self.count:
            frames = counted(self.count + results, "frame")
            raise CheckFailed(f"{self.count} of {frames} left out, see above")


def _reason(error: Exception) -> str:
    return short_line(" ".join(str(error).split()))


@dataclass
class Totals:
    """Counts over all frames, for the summary.

    Attributes:
        rig: The cameras, for how their depth was taken.
        stems: Follows the stems of a video or recording; None for pictures in no order, and for
            several sources.
        are_pictures: Whether no source is a video or recording.
    """

    rig: Rig = field(default_factory=Rig)
    trees: int = 0
    times_ms: list[float] = field(default_factory=list)
    metres_need: str | None = None
    scaling: str | None = None
    turning: str | None = None
    faults: list[str] = field(default_factory=list)
    unlike: list[str] = field(default_factory=list)
    alone: list[str] = field(default_factory=list)
    exponents: list[RangeExponent] = field(default_factory=list)
    checked_kinds: int = 0
    stems: PictureTracker | None = None
    are_pictures: bool = True

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.times_ms)

    def add(self, result: FrameResult) -> None:
        """Count a frame."""
        self.trees += len(result.trees)
        self.times_ms.append(result.detect_ms)
        self.metres_need = self.metres_need or result.metres_need
        self.scaling = self.scaling or result.scaling
        self.turning = self.turning or result.turning
        if result.frame.depth_fault is not None:
            self.faults.append(result.frame.depth_fault)
        if result.trees.unlike is not None:
            self.unlike.append(unlike_words(result.frame.name, result.trees.unlike))
        if result.trees.alone is not None:
            self.alone.append(f"{result.frame.name} {result.trees.alone}")
        if self.checked_kinds < _FRAMES_CHECKED and result.measurements is not None:
            self.checked_kinds += 1
            self.exponents += ground_exponents(result.frame, result.camera, self.rig)

    def lines(self) -> Iterator[str]:
        """The summary."""
        if not self.frames:  # as of a run that is interrupted at once
            yield "no frame"
            return
        median_ms = sorted(self.times_ms)[self.frames // 2]
        yield (
            f"{self._trees_words()} in {counted(self.frames, 'frame')},"
            f" {median_ms:.0f} ms each to detect"
        )
        if self.frames > 1 and self.trees:
            if self.stems is None:
                what = "pictures in no order" if self.are_pictures else "several sources"
                yield f"{what}: the same trees may be in several of them"
            elif isinstance(found := self.stems.different(), Failure):
                yield f"different trees not counted: {found.reason}"
        if self.metres_need is not None:
            yield f"metres {self.metres_need}"
        if self.scaling is not None:
            yield self.scaling
        if self.turning is not None:
            yield self.turning
        if self.faults:
            yield f"unusable depth in {counted(len(self.faults), 'frame')}: {self.faults[0]}"
        words = kind_words(self.exponents, self.rig.depth_kind)
        if words is not None:
            yield words
        if self.unlike:
            count = f"{len(self.unlike)} of {counted(self.frames, 'frame')}"
            yield f"{count} unlike the training pictures, the first: {self.unlike[0]}"
        if self.alone:
            count = f"{len(self.alone)} of {counted(self.frames, 'frame')}"
            yield f"{count} without one of colour and depth, the first: {self.alone[0]}"

    def _trees_words(self) -> str:
        """The number of trees, of different ones where they are followed."""
        times = counted(self.trees, "tree")
        if self.stems is None or self.frames == 1 or not self.trees:
            return times
        found = self.stems.different()
        return times if isinstance(found, Failure) else f"{different_words(found)} ({times} found)"


def different_words(count: Estimate) -> str:
    """The number of different trees as text."""
    return f"about {count.value:.0f} ± {max(count.std, 1):.0f} different trees"


def kind_of_depth_words(results: Iterable[FrameResult], rig: Rig) -> str | None:
    """Say that the depth of frames looks like the other kind; None if it does not."""
    found = [
        exponent
        for result in results
        for exponent in ground_exponents(result.frame, result.camera, rig)
    ]
    return kind_words(found, rig.depth_kind)


def unlike_words(name: str, unlike: UnlikeTraining) -> str:
    """A frame's name, how its image differs from those of the training, and what to try."""
    return f"{name}: {unlike}; {unlike.advice}"


def source_remarks(source: FrameSource) -> Iterator[str]:
    """What a source left out, and what it says about the frames that were used."""
    for what, count in source.counts.items():
        if count:
            yield f"{count} {what}" if what in REMARKS else f"{count} left out: {what}"


def check_complete(source: str, counts: Mapping[str, int]) -> None:
    """Raise CheckFailed if a part of the source could not be read."""
    if any(counts.get(name) for name in INCOMPLETE):
        raise CheckFailed(f"{source} is not complete, see above: what can be read was used")


def note_files(paths: Mapping[str, Path | None]) -> None:
    """Say where the output files are, by what they are."""
    for name, path in paths.items():
        if path is not None:
            note(f"{name}: {path}")


@contextmanager
def warnings_shown() -> Iterator[None]:
    """Print what the packages log, from warnings on, as notes."""

    logs = [logging.getLogger(name) for name in ("basetree", "calib", "edgetree")]
    handler = LogNotes(logging.WARNING)
    for log in logs:
        log.addHandler(handler)
    try:
        yield
    finally:
        for log in logs:
            log.removeHandler(handler)
