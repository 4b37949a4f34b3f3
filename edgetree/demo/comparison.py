"""Compare measurements with the ground truth, per tree and over all trees."""

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
    "GROSS_DIAMETER_SHARE",
    "GROSS_STDS",
    "QUANTITIES",
    "FrameComparison",
    "QuantitySummary",
    "TreeComparison",
    "compare_trees",
    "summarise",
]

QUANTITIES: Final = ("diameter_m", "cut_height_m", "distance_m")

GROSS_STDS: Final = 3.0
GROSS_DIAMETER_SHARE: Final = 0.2


@dataclass(frozen=True, eq=False)
class TreeComparison:
    """A tree of the ground truth, and the measurement of the detection that matches it.

    Attributes:
        truth: the ground truth.
        score: score of the detection; None if the tree was not found.
        measurement: measurement of the detection; None if the tree was not found.
    """

    truth: SampleTree
    score: float | None
    measurement: TreeMeasurement | None

    @property
    def found(self) -> bool:
        """Whether a detection matches this tree."""
        return self.measurement is not None

    def estimate(self, quantity: str) -> Estimate | None:
        """The measured value of one of `QUANTITIES`; None if there is none."""
        value = getattr(self.measurement, quantity, None)
        return value if isinstance(value, Estimate) else None

    def failure(self, quantity: str) -> str | None:
        """Why one of `QUANTITIES` could not be measured; None if it was, or the tree not found."""
        value = getattr(self.measurement, quantity, None)
        return value.reason if isinstance(value, Failure) else None

    def error_m(self, quantity: str) -> float | None:
        """Measured minus true value of one of `QUANTITIES`; None if it was not measured."""
        estimate = self.estimate(quantity)
        return None if estimate is None else estimate.value - float(getattr(self.truth, quantity))

    def is_gross(self, quantity: str) -> bool:
        """Whether one of `QUANTITIES` has a gross error.

        It is gross if it is more than `GROSS_STDS` standard deviations; for a diameter also if it
        is more than `GROSS_DIAMETER_SHARE` of the true diameter.
        """
        estimate, error_m = self.estimate(quantity), self.error_m(quantity)
        if estimate is None or error_m is None:
            return False
        limit_m = GROSS_STDS * estimate.std
        if quantity == "diameter_m":
            limit_m = min(limit_m, GROSS_DIAMETER_SHARE * self.truth.diameter_m)
        return abs(error_m) > limit_m

    def to_dict(self) -> dict[str, Any]:
        """A flat JSON object: the truth as `true_*` in metres, and the measurement."""
        truth = {f"true_{quantity}": getattr(self.truth, quantity) for quantity in QUANTITIES}
        measured = {} if self.measurement is None else self.measurement.to_dict()
        return {"found": self.found, "score": self.score, **truth, **measured}


@dataclass(frozen=True)
class FrameComparison:
    """The comparison of one model on one frame.

    Attributes:
        frame: name of the frame.
        trees: the trees of the ground truth.
        unmatched_detections: number of detections that match no tree of the ground truth.
    """

    frame: str
    trees: tuple[TreeComparison, ...]
    unmatched_detections: int


class QuantitySummary(NamedTuple):
    """Errors of one quantity over all trees where it was measured.

    Attributes:
        measured: number of these trees. If it is 0, the other values are None.
        median_abs_error_m: median absolute error in metres.
        median_relative_error: median absolute error divided by the true value.
        within_one_std: share of errors within one standard deviation, in [0, 1]. Normally
            distributed errors give 0.68.
        within_two_std: share of errors within two standard deviations, in [0, 1]. Normally
            distributed errors give 0.95.
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
    """Compare the measurements of one frame with its ground truth.

    Args:
        frame: name of the frame.
        truths: the trees of the ground truth.
        matches: pairs of detections and trees of the ground truth.
        scores: score of each detection.
        measurements: measurement of each detection.
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
    """Summarise the errors of one of `QUANTITIES` over all trees of all frames."""
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
