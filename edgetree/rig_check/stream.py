"""The stream itself: faults of the depth, images that repeat, time stamps, and what is left out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from basetree.arrays import UInt8
from basetree.counts import counted
from calib import DepthFailure, check_depth
from edgetree.frames.frame import Frame
from edgetree.rig_check.checks import HOLDS, NO, UNKNOWN, RigCheck, Verdict
from edgetree.sources.source import DEPTH_PLACED_BY_GUESS, REMARKS

GROUP: Final = "frames"

_LIMIT_PERCENT: Final = 5.0
_FROZEN_LIMIT_PERCENT: Final = 1.0
# Mean difference of two pictures, grey levels, above which something moved. The noise of a camera
# is less; it makes pictures differ where nothing moves, so that equal ones are the same picture.
_CHANGED_LEVELS: Final = 1.0
_SAMPLED: Final = 4
# Some sources stamp their frames by a clock of their own, which always rises. They count the wrong
# stamps of the cameras under these names.
_WRONG_STAMPS: Final = frozenset(
    {
        "colour with a repeated or late stamp",
        "depth with a repeated or late stamp",
        "clock jumped back",
    }
)
# A gap is longer than this many periods.
_GAP_PERIODS: Final = 2.5
_FEWEST: Final = 20


class StreamCounts:
    """Counts over all frames of a source.

    Attributes:
        frames: Number of frames with colour and depth.
        times_s: Their time stamps.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.times_s: list[float] = []
        self._incomplete = 0
        self._faults = 0
        self._first_fault = ""
        self._shares: list[float] = []
        self._frozen_depth = self._frozen_colour = 0
        self._last: Frame | None = None

    def add(self, frame: Frame) -> bool:
        """Count a frame; returns whether it can be used for the other checks."""
        if frame.image is None or frame.depth_m is None:
            self._incomplete += 1
            return False
        self.frames += 1
        self.times_s.append(frame.stamp_s)
        check = check_depth(frame.depth_m)
        fault = frame.depth_fault or (check.reason if isinstance(check, DepthFailure) else "")
        if fault:
            self._faults += 1
            self._first_fault = self._first_fault or f"frame {frame.number}: {fault}"
        elif not isinstance(check, DepthFailure):
            self._shares.append(check.valid_share)
        self._compare(frame)
        self._last = frame
        return not fault

    def _compare(self, frame: Frame) -> None:
        """Count an image that is the last one again, while the other one changed."""
        last = self._last
        if last is None or last.image is None or last.depth_m is None:
            return
        if frame.image is None or frame.depth_m is None or last.image.shape != frame.image.shape:
            return
        changed = _difference(last.image, frame.image) > _CHANGED_LEVELS
        same_depth = np.array_equal(last.depth_m, frame.depth_m)
        self._frozen_depth += same_depth and changed
        self._frozen_colour += not same_depth and np.array_equal(last.image, frame.image)

    def checks(self, source_counts: Mapping[str, int]) -> list[RigCheck]:
        """The checks.

        Args:
            source_counts: The `counts` of the source: frames left out, pictures with wrong time
                stamps, and remarks on frames that were used.
        """
        wrong = {what: source_counts[what] for what in _WRONG_STAMPS & source_counts.keys()}
        left_out = {
            what: count
            for what, count in source_counts.items()
            if count and what not in REMARKS | _WRONG_STAMPS
        }
        pairs = max(self.frames - 1, 1)
        steps = np.diff(self.times_s)
        backwards = int((steps <= 0).sum())
        period_s = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        gaps = int((steps > _GAP_PERIODS * period_s).sum()) if period_s else 0
        lost = self._incomplete + sum(left_out.values())
        share = 100 * float(np.mean(self._shares)) if self._shares else 0.0
        left = _told(left_out) or "colour or depth alone"
        clock = ": ".join(filter(None, ("the clock is wrong", _told(wrong))))
        late = sum(wrong.values())
        rows = (
            ("depth that repeats", self._frozen_depth, pairs, "the depth camera hangs"),
            ("colour that repeats", self._frozen_colour, pairs, "the colour camera hangs"),
            ("time stamps that do not rise", backwards + late, pairs + late, clock),
        )
        return [
            self._share("faulty depth", self._faults, self.frames, self._first_fault),
            self._placed(source_counts.get(DEPTH_PLACED_BY_GUESS, 0)),
            RigCheck("pixels with depth", GROUP, HOLDS, None, "%", share),
            *(
                self._share(name, count, total, reason, _FROZEN_LIMIT_PERCENT)
                for name, count, total, reason in rows
            ),
            self._share("gaps in time", gaps, pairs, "frames are lost: cable, load or disk"),
            self._share("frames left out", lost, self.frames + lost, left),
        ]

    def _placed(self, guesses: int) -> RigCheck:
        """Whether the place of the depth camera is known; one frame tells."""
        reason = (
            "depth and colour have one frame and other lenses: record aligned depth, or frames of"
            " their own with a transform"
        )
        return RigCheck(
            "depth from an unknown place",
            GROUP,
            NO if guesses else HOLDS,
            0.0,
            "%",
            100 * guesses / max(self.frames, 1),
            reason=reason if guesses else "",
        )

    def _share(
        self, name: str, count: int, total: int, reason: str, limit: float = _LIMIT_PERCENT
    ) -> RigCheck:
        percent = 100 * count / max(total, 1)
        verdict: Verdict = HOLDS if percent <= limit else NO
        if total < _FEWEST:
            verdict, reason = UNKNOWN, f"{counted(total, 'frame')}: {_FEWEST} are needed"
        return RigCheck(
            name, GROUP, verdict, limit, "%", percent, None, "" if verdict == HOLDS else reason
        )


def _told(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {what}" for what, count in sorted(counts.items()))


def _difference(first: UInt8, second: UInt8) -> float:
    """Mean difference of two pictures in grey levels, on some of their pixels."""
    a, b = (each[::_SAMPLED, ::_SAMPLED].astype(np.int16) for each in (first, second))
    return float(np.abs(a - b).mean())
