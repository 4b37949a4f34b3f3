"""Compare measurements with the ground truth, per tree and over all trees."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Final, NamedTuple

import numpy as np

from basetree.page.parts import Jpeg
from edgetree.check import CaliperStem, Comparison, MeasuredStem, Pair
from edgetree.check.quantities import OUTLIER_STDS
from edgetree.demo.matching import Match
from edgetree.measure import Estimate, Failure, TreeMeasurement
from edgetree.samples import SampleTree

QUANTITIES: Final = ("diameter_m", "cut_height_m", "distance_m")

GROSS_DIAMETER_SHARE: Final = 0.2
"""An error of the diameter is gross from this share of the diameter on."""


@dataclass(frozen=True, eq=False)
class TreeComparison:
    """A tree of the ground truth, and the measurement of the detection that matches it.

    Attributes:
        frame: Name of the frame.
        number: Number of the tree in the frame, from 1.
        truth: The ground truth.
        score: Score of the detection; None if the tree was not found.
        measurement: Measurement of the detection; None if the tree was not found.
    """

    frame: str
    number: int
    truth: SampleTree
    score: float | None
    measurement: TreeMeasurement | None

    @property
    def found(self) -> bool:
        """Whether a detection matches this tree."""
        return self.measurement is not None

    def compared(self, quantity: str) -> Comparison | None:
        """One of `QUANTITIES` with its error; None if it was not measured."""
        measured = getattr(self.measurement, quantity, None)
        if not isinstance(measured, Estimate):
            return None
        true = Estimate(float(getattr(self.truth, quantity)), 0.0)
        pair = Pair(
            MeasuredStem(self.frame, self.number, {quantity: measured}),
            CaliperStem(self.number, {quantity: true}, self.frame, self.number),
        )
        return Comparison(pair, measured, true)

    def missing(self, quantity: str) -> str:
        """Why one of `QUANTITIES` has no value; empty if it has one."""
        value = getattr(self.measurement, quantity, Failure("not found"))
        return value.reason if isinstance(value, Failure) else ""

    def to_dict(self) -> dict[str, Any]:
        """A flat JSON object: the truth as `true_*` in metres, and the measurement."""
        truth = {f"true_{quantity}": getattr(self.truth, quantity) for quantity in QUANTITIES}
        measured = {} if self.measurement is None else self.measurement.to_dict()
        return {"found": self.found, "score": self.score, **truth, **measured}


@dataclass(frozen=True)
class FrameComparison:
    """The comparison of one model on one frame.

    Attributes:
        frame: Name of the frame.
        trees: The trees of the ground truth.
        unmatched_detections: Number of detections that match no tree of the ground truth.
        picture: The frame with the detections drawn on it; None if they were not drawn.
    """

    frame: str
    trees: tuple[TreeComparison, ...]
    unmatched_detections: int
    picture: Jpeg | None = None


class QuantitySummary(NamedTuple):
    """Errors of one quantity over all trees where it was measured.

    Attributes:
        measured: Number of these trees. If it is 0, the other values are None.
        median_abs_error_m: Median absolute error in metres.
        median_relative_error: Median absolute error divided by the true value.
        within_one_std: Share of errors within one standard deviation, in [0, 1]. Errors as
            `Estimate.interval` takes them give 0.77.
        within_two_std: Share of errors within two standard deviations, in [0, 1]. Such errors give
            0.95.
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
    picture: Jpeg | None = None,
) -> FrameComparison:
    """Compare the measurements of one frame with its ground truth.

    Args:
        frame: Name of the frame.
        truths: The trees of the ground truth.
        matches: Pairs of detections and trees of the ground truth.
        scores: Score of each detection.
        measurements: Measurement of each detection.
        picture: The frame with the detections drawn on it.
    """
    found = {match.truth: match.detection for match in matches}
    trees = []
    for index, truth in enumerate(truths):
        detection = found.get(index)
        score = None if detection is None else scores[detection]
        measurement = None if detection is None else measurements[detection]
        trees.append(TreeComparison(frame, index + 1, truth, score, measurement))
    return FrameComparison(frame, tuple(trees), len(measurements) - len(found), picture)


def compared(frames: Iterable[FrameComparison], quantity: str) -> list[Comparison]:
    """One of `QUANTITIES` of all trees of all frames where it was measured."""
    trees = (tree for frame in frames for tree in frame.trees)
    return [found for tree in trees if (found := tree.compared(quantity)) is not None]


def is_gross(quantity: str, found: Comparison) -> bool:
    """Whether one of `QUANTITIES` has a gross error.

    It is gross if it is more than `OUTLIER_STDS` standard deviations; for a diameter also if it is
    more than `GROSS_DIAMETER_SHARE` of the true diameter.
    """
    limit_m = OUTLIER_STDS * found.error.std
    if quantity == "diameter_m":
        limit_m = min(limit_m, GROSS_DIAMETER_SHARE * found.caliper.value)
    return abs(found.error.value) > limit_m


def summarise(frames: Iterable[FrameComparison], quantity: str) -> QuantitySummary:
    """Summarise the errors of one of `QUANTITIES` over all trees of all frames."""
    found = compared(frames, quantity)
    if not found:
        return QuantitySummary(0, None, None, None, None)
    relative = [
        abs(each.error.value) / each.caliper.value for each in found if each.caliper.value > 0.0
    ]
    off = np.abs([each.standardised for each in found])
    return QuantitySummary(
        measured=len(found),
        median_abs_error_m=median(abs(each.error.value) for each in found),
        median_relative_error=median(relative) if relative else None,
        within_one_std=float(np.mean(off <= 1.0)),
        within_two_std=float(np.mean(off <= 2.0)),
    )
