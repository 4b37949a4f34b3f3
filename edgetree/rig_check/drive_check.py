"""Read a source once and check the rig that it is from."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from basetree.arrays import UInt8
from basetree.counts import counted
from basetree.errors import InputError
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.rig_check.alignment import FrameSilhouettes, alignment_checks
from edgetree.rig_check.checks import NO, UNKNOWN, RigCheck
from edgetree.rig_check.image_motion import image_velocity
from edgetree.rig_check.odometry import odometry_checks
from edgetree.rig_check.silhouettes import find_silhouettes
from edgetree.rig_check.stem_sightings import StemFinder
from edgetree.rig_check.stream import StreamCounts
from edgetree.rig_check.vertical import vertical_checks
from edgetree.sources.source import FrameSource

if TYPE_CHECKING:
    from edgetree.runtime.detector import TreeDetector

_EVERY_S: Final = 0.5
_MOST_WAITING: Final = 3
_FEWEST_FRAMES: Final = 2


@dataclass(frozen=True)
class RigReport:
    """The checks of a rig.

    Attributes:
        source: Name of the source.
        seconds: From the first to the last frame, s.
        frames: Frames with colour and depth.
        used: Those that were searched for silhouettes and stems.
        silhouettes: Points on silhouettes that were found.
        stems: Stems that were found.
        checks: The checks.
    """

    source: str
    seconds: float
    frames: int
    used: int
    silhouettes: int
    stems: int
    checks: list[RigCheck]

    @property
    def problems(self) -> list[RigCheck]:
        """The checks that do not hold."""
        return [check for check in self.checks if check.verdict == NO]

    @property
    def unknown(self) -> list[RigCheck]:
        """The checks that cannot tell."""
        return [check for check in self.checks if check.verdict == UNKNOWN]

    @property
    def passed(self) -> bool:
        """Whether no check fails."""
        return not self.problems

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary."""
        return {
            "source": self.source,
            "seconds": self.seconds,
            "frames": self.frames,
            "used_frames": self.used,
            "silhouettes": self.silhouettes,
            "stems": self.stems,
            "checks": [check.to_dict() for check in self.checks],
            "passed": self.passed,
        }


def check_rig(
    source: FrameSource, detector: TreeDetector, rig: Rig | None = None, seconds: float = 60.0
) -> RigReport:
    """Check calibration and alignment from a drive.

    Reads all frames, and searches two per second for silhouettes and stems. Closes the source.

    Args:
        source: a camera or a recording with colour and depth.
        detector: Finds the stems.
        rig: The camera and the vertical of sources that do not know them.
        seconds: How much of the source is read from its first frame on, s: by its time stamps
            and, if it is live, by this machine's clock too.

    Raises:
        InputError: The source has no colour, no depth, no camera, fewer than two frames with
            both, or frames of different sizes.
    """
    counts, work = StreamCounts(), _Work(detector, rig or Rig(), source.name)
    limit = _TimeLimit(seconds, is_live=source.is_live)
    before: Frame | None = None
    any_colour = any_depth = False
    with ThreadPoolExecutor(1) as pool:
        waiting: list[Future[None]] = []
        try:
            for frame in source:
                any_colour |= frame.image is not None
                any_depth |= frame.depth_m is not None
                if limit.is_over(frame.stamp_s):
                    break
                usable = counts.add(frame)
                if usable and work.is_due(frame.stamp_s):
                    waiting = [each for each in waiting if not _is_done(each)]
                    # Frames of a camera do not wait.
                    if len(waiting) < _MOST_WAITING or not source.is_live:
                        waiting.append(pool.submit(work.add, frame, before))
                    if len(waiting) > _MOST_WAITING:
                        waiting.pop(0).result()
                before = frame if frame.image is not None else before
            for each in waiting:
                each.result()
        finally:
            source.close()
    if not (any_colour and any_depth):
        lacking = "depth" if any_colour else "colour"
        raise InputError(f"{source.name} has no {lacking}: expected frames with colour and depth")
    if counts.frames < _FEWEST_FRAMES:
        raise InputError(
            f"{source.name} has {counted(counts.frames, 'frame')} with colour and depth:"
            " expected at least two"
        )
    return work.report(source, counts)


def _is_done(work: Future[None]) -> bool:
    """Whether it is done; raises what it raised."""
    if not work.done():
        return False
    work.result()
    return True


class _TimeLimit:
    """Ends a source some seconds after its first frame.

    A camera also ends by this machine's clock, because its time stamps may stand still.
    """

    def __init__(self, seconds: float, *, is_live: bool) -> None:
        self._seconds, self._is_live = seconds, is_live
        self._first: tuple[float, float] | None = None

    def is_over(self, time_s: float) -> bool:
        """Whether a frame with this time stamp, which has come now, is beyond the limit."""
        now_s = time.monotonic()
        self._first = self._first or (time_s, now_s)
        first_s, start_s = self._first
        if time_s - first_s > self._seconds:
            return True
        return self._is_live and now_s - start_s > self._seconds


class _Work:
    """What is found in the frames that are searched."""

    def __init__(self, detector: TreeDetector, rig: Rig, name: str) -> None:
        self._rig, self._name = rig, name
        self._stems = StemFinder(detector, rig)
        self._silhouettes: list[FrameSilhouettes] = []
        self._last_s: float | None = None
        self._frame: Frame | None = None

    def is_due(self, time_s: float) -> bool:
        """Whether a frame at this time is searched; from then on, the next is half a second on."""
        if self._last_s is not None and abs(time_s - self._last_s) < _EVERY_S * 0.99:
            return False
        self._last_s = time_s
        return True

    def add(self, frame: Frame, before: Frame | None) -> None:
        """Search a frame; `before` is the one before it, for the motion of the picture."""
        image, depth_m = frame.image, frame.depth_m
        if image is None or depth_m is None:
            return
        self._check_size(frame.number or 0, image)
        frame = self._rig.completed(frame, image.shape[1], image.shape[0])
        if frame.camera is None:
            raise InputError(f"frame {frame.number} has no camera: pass --camera")
        self._frame = frame
        found = find_silhouettes(image, depth_m, frame.number or 0)
        velocity = np.zeros_like(found.xy_px)
        if before is not None and before.image is not None:
            step_s = frame.stamp_s - before.stamp_s
            velocity = image_velocity(before.image, image, step_s, found.xy_px)
        self._silhouettes.append(FrameSilhouettes(frame.stamp_s, found, velocity))
        self._stems.add(frame)

    def _check_size(self, number: int, image: UInt8) -> None:
        """Raise InputError if an image is not as large as that of the frame searched before."""
        last = self._frame
        if last is None or last.image is None or last.image.shape == image.shape:
            return
        raise InputError(
            f"{self._name}: frame {number} is {_size(image)} px and frame {last.number}"
            f" {_size(last.image)} px: expected frames of one size"
        )

    def report(self, source: FrameSource, counts: StreamCounts) -> RigReport:
        """The checks over all frames."""
        checks = counts.checks(source.counts)
        sightings = self._stems.sightings
        if self._frame is not None and self._frame.camera is not None:
            checks = alignment_checks(self._silhouettes, self._frame.camera) + checks
            checks[6:6] = vertical_checks(sightings) + odometry_checks(sightings)
        return RigReport(
            source=source.name,
            seconds=max(counts.times_s) - min(counts.times_s),
            frames=counts.frames,
            used=len(self._silhouettes),
            silhouettes=sum(len(each.silhouettes) for each in self._silhouettes),
            stems=len({each.stem for each in sightings}),
            checks=checks,
        )


def _size(image: UInt8) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"
