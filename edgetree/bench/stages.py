"""Where the time of a frame goes: reading, preparing, the parts of the network, results, metres."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from edgetree.bench.frames import BenchFrame
from edgetree.bench.profile import PARTS
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import OrtSession

STAGES: Final = ("decode", "pre", *PARTS, "post", "measure")
"""Stages of a frame: read and decode the file; resize and encode; the parts of the network; check
the outputs, select trees and map them to the image; measure them in metres."""

_MOST_RUNS, _FEWEST_RUNS, _LONGEST_S = 12, 3, 4.0


class _TimedSession(OrtSession):
    """A session that notes when its last run began and ended."""

    began_s = ended_s = 0.0

    def run(self, inputs: Any) -> dict[str, NDArray[Any]]:
        self.began_s = time.perf_counter()
        outputs = super().run(inputs)
        self.ended_s = time.perf_counter()
        return outputs


def stages_ms(
    frames: Sequence[BenchFrame],
    open_as: Callable[[type[OrtSession]], OrtSession],
    parts_ms: dict[str, float],
) -> dict[str, float | None]:
    """Median time of each of `STAGES`, one frame at a time.

    Args:
        frames: The frames, at least one.
        open_as: Opens the model in a session of the given class.
        parts_ms: Times of the parts of the network from a profile, which makes all of them a little
            slower: only their proportions are used.

    Returns:
        The times in milliseconds; None for measuring where a frame lacks depth or camera.
    """
    session = open_as(_TimedSession)
    assert isinstance(session, _TimedSession)
    detector = TreeDetector(session)
    detector.warm_up(rounds=1)
    start_s = time.perf_counter()
    measured: list[tuple[float, float, float, float]] = []
    while len(measured) < _FEWEST_RUNS or (
        len(measured) < _MOST_RUNS and time.perf_counter() - start_s < _LONGEST_S
    ):
        measured.append(_one_frame(detector, session, frames[len(measured) % len(frames)]))
    pre, network, post = (median(each[index] for each in measured) for index in range(3))
    metres = [each[3] for each in measured]
    share = network / max(sum(parts_ms.values()), 1e-9)
    return {
        "decode": median(frame.decode_ms for frame in frames),
        "pre": pre,
        **{part: parts_ms[part] * share for part in PARTS},
        "post": post,
        "measure": None if np.isnan(metres).any() else median(metres),
    }


def _one_frame(
    detector: TreeDetector, session: _TimedSession, frame: BenchFrame
) -> tuple[float, float, float, float]:
    """Milliseconds before, in and after the network, and for measuring (NaN if not possible)."""
    from edgetree.measure import measure_trees

    start_s = time.perf_counter()
    trees = detector.detect(frame.image)
    found_s = time.perf_counter()
    metres_ms = float("nan")
    if frame.depth_m is not None and frame.camera is not None:
        measure_trees(trees, frame.depth_m, frame.camera, up_camera=frame.up_camera)
        metres_ms = (time.perf_counter() - found_s) * 1000
    return (
        (session.began_s - start_s) * 1000,
        (session.ended_s - session.began_s) * 1000,
        (found_s - session.ended_s) * 1000,
        metres_ms,
    )
