"""What a live pipeline tells about itself: rates, times per stage, and what was left out."""

from __future__ import annotations

import statistics
import threading
import time
from collections import Counter, deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Literal

from basetree.counts import counted, kind_of_line
from edgetree.sources.source import REMARKS

STALE_S: Final = 2.0
"""Time without a result after which a camera counts as silent, s."""
STALE_FRAMES: Final = 5
"""Frame times of a slow camera after which it does."""
_REMEMBERED: Final = 50  # results for rates and medians
_SLOW_SHARE, _FEW_STEPS = 0.9, 20
_MOST_REASONS: Final = 40
_OTHER_REASONS: Final = "other reasons"


@dataclass(frozen=True)
class LiveStatus:
    """The state of a live pipeline.

    Attributes:
        state: "starting" before the first result; "running"; "lost" while the source does not
            answer; "ended".
        results: Number of frames that have a result.
        dropped: Frames that were left out because newer ones had arrived.
        left_out: Frames that could not be used, by reason, with what the source left out itself.
            Reasons that differ in numbers alone are counted under the first of them.
        remarks: What the source says about frames that were used, such as {"without pose": 60}.
        lost: How many times the source was lost.
        rate_hz: Results per second, over the last 50 without gaps; 0 before the second.
        stages_ms: Median time of each stage over the last 50 results, ms.
        age_ms: Median time from a frame's arrival to its result, likewise.
        silent_s: Time since the last result, s.
        busy_s: How long a stage, or the caller, has worked on the frame that it has, s.
        fault: Why the source is lost; empty if it is not.
        slow_frame_s: Time between two results that 90 % of the last 50 do not exceed, s; of fewer
            than 20 the median; 0 before the second.
    """

    state: Literal["starting", "running", "lost", "ended"]
    results: int
    dropped: int
    left_out: dict[str, int]
    lost: int
    rate_hz: float
    stages_ms: dict[str, float]
    age_ms: float
    silent_s: float
    remarks: dict[str, int] = field(default_factory=dict)
    busy_s: float = 0.0
    fault: str = ""
    slow_frame_s: float = 0.0

    def line(self) -> str:
        """The state as one line of text."""
        stages = ", ".join(f"{name} {value:.0f}" for name, value in self.stages_ms.items())
        parts = [f"{self.state}: {counted(self.results, 'frame')}, {self.rate_hz:.1f} per second"]
        if stages:
            parts.append(f"{self.age_ms:.0f} ms old ({stages} ms)")
        if self.dropped:
            parts.append(f"{self.dropped} dropped")
        parts += [f"{count} left out: {reason}" for reason, count in self.left_out.items()]
        parts += [f"{count} {remark}" for remark, count in self.remarks.items()]
        if self.lost:
            parts.append(f"source lost {counted(self.lost, 'time')}")
        return ", ".join(parts)


@dataclass
class StatusRecorder:
    """Collects the state of a pipeline. Thread-safe."""

    is_lost: bool = False
    is_ended: bool = False
    lost: int = 0
    results: int = 0
    left_out: Counter[str] = field(default_factory=Counter)
    fault: str = ""
    _reasons: dict[str, str] = field(default_factory=dict)  # the first one of each kind
    _busy_since_s: dict[str, float] = field(default_factory=dict)
    _times_s: deque[float] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    _stages: deque[dict[str, float]] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    _ages_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    _began_s: float = field(default_factory=time.monotonic)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, stages_ms: dict[str, float], age_s: float) -> None:
        """Count a result."""
        with self._lock:
            self.results += 1
            self._times_s.append(time.monotonic())
            self._stages.append(stages_ms)
            self._ages_ms.append(age_s * 1000)

    def leave_out(self, reason: str) -> int:
        """Count a frame that could not be used; returns how many reasons of its kind have."""
        kind = kind_of_line(reason)
        with self._lock:
            if kind not in self._reasons and len(self._reasons) >= _MOST_REASONS:
                kind, reason = "", _OTHER_REASONS
            reason = self._reasons.setdefault(kind, reason)
            self.left_out[reason] += 1
            return self.left_out[reason]

    def lose_source(self, why: str) -> None:
        """Count that the source was lost."""
        with self._lock:
            self.is_lost, self.fault = True, why
            self.lost += 1

    def begin(self, stage: str) -> None:
        """A stage has taken a frame."""
        with self._lock:
            self._busy_since_s[stage] = time.monotonic()

    def end(self, stage: str) -> None:
        """A stage has handed its frame on."""
        with self._lock:
            self._busy_since_s.pop(stage, None)

    def status(self, dropped: int, of_source: dict[str, int]) -> LiveStatus:
        """The state now.

        Args:
            dropped: Frames that were replaced by newer ones.
            of_source: What the source counted.
        """
        with self._lock:
            times, now = list(self._times_s), time.monotonic()
            steps_s = sorted(after - before for before, after in pairwise(times))
            slow_s = _slow_step_s(steps_s)
            # Of a gap, the rate says nothing.
            usual_s = [step for step in steps_s if step <= max(STALE_S, STALE_FRAMES * slow_s)]
            taken_s = sum(usual_s)
            names = dict.fromkeys(name for stages in self._stages for name in stages)
            stages_ms = {
                name: statistics.median(row[name] for row in self._stages if name in row)
                for name in names
            }
            return LiveStatus(
                state=self._state(),
                results=self.results,
                dropped=dropped,
                left_out=self.left_out
                | {name: count for name, count in of_source.items() if name not in REMARKS},
                lost=self.lost,
                rate_hz=len(usual_s) / taken_s if taken_s > 0 else 0.0,
                slow_frame_s=slow_s,
                stages_ms=stages_ms,
                age_ms=statistics.median(self._ages_ms) if self._ages_ms else 0.0,
                silent_s=now - (times[-1] if times else self._began_s),
                remarks={name: count for name, count in of_source.items() if name in REMARKS},
                busy_s=now - min(self._busy_since_s.values(), default=now),
                fault=self.fault if self.is_lost else "",
            )

    def _state(self) -> Literal["starting", "running", "lost", "ended"]:
        if self.is_ended:
            return "ended"
        if self.is_lost:
            return "lost"
        return "running" if self.results else "starting"


def _slow_step_s(steps_s: list[float]) -> float:
    """The step that 90 % do not exceed, or the median of few, which a gap cannot move.

    Args:
        steps_s: Times between results, the shortest first, s.
    """
    if not steps_s:
        return 0.0
    share = _SLOW_SHARE if len(steps_s) >= _FEW_STEPS else 0.5
    return steps_s[int(share * (len(steps_s) - 1))]
