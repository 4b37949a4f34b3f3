"""Metres against the truth: per tree, and over all trees."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Final, NamedTuple

import numpy as np

from edgetree.demo.matching import Match
from edgetree.measure import Estimate, Failure, TreeMeasurement
from edgetree.samples import SampleTree

__all__ = [
    "QUANTITIES",
    "FrameComparison",
    "QuantitySummary",
    "TreeComparison",
    "compare_trees",
    "summarise",
]

QUANTITIES: Final = ("diameter_m", "cut_height_m", "distance_m")


@dataclass(frozen=True, eq=False)
class TreeComparison:
    """One true tree and what was measured on the detection that found it, if one did."""

    truth: SampleTree
    score: float | None
    measurement: TreeMeasurement | None

    @property
    def found(self) -> bool:
        """Whether a detection overlaps this tree enough."""
        return self.measurement is not None

    def estimate(self, quantity: str) -> Estimate | None:
        """The measured value of one of `QUANTITIES`, None where there is none."""
        value = getattr(self.measurement, quantity, None)
        return value if isinstance(value, Estimate) else None

    def failure(self, quantity: str) -> str | None:
        """Why one of `QUANTITIES` could not be measured on a tree that was found."""
        value = getattr(self.measurement, quantity, None)
        return value.reason if isinstance(value, Failure) else None

    def to_dict(self) -> dict[str, Any]:
        """Flat and JSON-ready: `true_*` in metres, and all that was measured, or why it was not."""
        truth = {f"true_{quantity}": getattr(self.truth, quantity) for quantity in QUANTITIES}
        measured = {} if self.measurement is None else self.measurement.to_dict()
        return {"found": self.found, "score": self.score, **truth, **measured}


@dataclass(frozen=True)
class FrameComparison:
    """One model on one frame: every true tree, and how many detections are none of them."""

    frame: str
    trees: tuple[TreeComparison, ...]
    unmatched_detections: int


class QuantitySummary(NamedTuple):
    """How close one quantity came, over the trees where it was measured.

    `within_one_std` and `within_two_std` are shares in [0, 1]; errors of a normal distribution
    would give 0.68 and 0.95. All but the count are None where nothing was measured.
    """

    measured: int
    median_abs_error_m: float | None
    median_relative_error: float | None
    within_one_std: float | None
    within_two_std: float | None


def compare_trees(
    frame: str,
    truths: Sequence[SampleTree],
    matches: Iterable[Match],
    scores: Sequence[float],
    measurements: Sequence[TreeMeasurement],
) -> FrameComparison:
    """Put the measurements of one frame beside its true trees.

    Args:
        frame: the frame's name.
        truths: its true trees.
        matches: which detection is which of them.
        scores: one per detection.
        measurements: one per detection.
    """
    of_truth = {match.truth: match.detection for match in matches}
    trees = []
    for index, truth in enumerate(truths):
        detection = of_truth.get(index)
        if detection is None:
            trees.append(TreeComparison(truth, None, None))
        else:
            trees.append(TreeComparison(truth, scores[detection], measurements[detection]))
    return FrameComparison(frame, tuple(trees), len(measurements) - len(of_truth))


def summarise(frames: Iterable[FrameComparison], quantity: str) -> QuantitySummary:
    """Medians over all trees of all frames, each tree counting once."""
    errors_m, relative, stds_m = [], [], []
    for tree in (tree for frame in frames for tree in frame.trees):
        estimate = tree.estimate(quantity)
        if estimate is None:
            continue
        true_m = float(getattr(tree.truth, quantity))
        errors_m.append(abs(estimate.value - true_m))
        stds_m.append(estimate.std)
        if true_m > 0.0:
            relative.append(errors_m[-1] / true_m)
    if not errors_m:
        return QuantitySummary(0, None, None, None, None)

    def share_within(stds: float) -> float:
        return float(np.mean(np.array(errors_m) <= stds * np.array(stds_m)))

    return QuantitySummary(
        measured=len(errors_m),
        median_abs_error_m=median(errors_m),
        median_relative_error=median(relative) if relative else None,
        within_one_std=share_within(1.0),
        within_two_std=share_within(2.0),
    )
