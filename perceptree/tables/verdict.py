"""Test a claim with several seeds: Student's t-test with a pooled standard deviation."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

Word = Literal["agrees", "disagrees", "undecided"]

RULE = (
    "A claim is decided if the difference of the means exceeds its 95 % confidence interval"
    " (Student's t, standard deviation between seeds pooled over all rows of the table). Otherwise,"
    " and always with one seed, it is undecided. The interval does not cover other test frames."
)

# Two-sided 95 % quantiles of Student's t for 1, 2, ... 10 degrees of freedom; 10 for more.
_T95 = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228)
_MIN_SEEDS = 2


@dataclass(frozen=True)
class Verdict:
    """Result of testing a claim.

    Attributes:
        difference: First mean minus second mean; None without scores.
        interval: Half width of its 95 % confidence interval; None with fewer than two seeds.
        word: "agrees", "disagrees" or "undecided".
    """

    difference: float | None
    interval: float | None
    word: Word


def pooled_deviation(groups: Iterable[Sequence[float]]) -> tuple[float, int]:
    """Return the pooled standard deviation within groups and its degrees of freedom.

    Groups with one value are left out; the result is (0, 0) without any other.
    """
    several = [group for group in groups if len(group) >= _MIN_SEEDS]
    degrees_of_freedom = sum(len(group) - 1 for group in several)
    if not degrees_of_freedom:
        return 0.0, 0
    squares = sum((len(group) - 1) * statistics.variance(group) for group in several)
    return math.sqrt(squares / degrees_of_freedom), degrees_of_freedom


def judge(
    scores: Sequence[float],
    others: Sequence[float],
    groups: Iterable[Sequence[float]],
    rises: bool = True,
) -> Verdict:
    """Test whether `scores` are higher than `others`.

    Args:
        scores: Scores of the first model, by seed.
        others: Scores of the second model, by seed.
        groups: Scores of all rows of the table; their standard deviations are pooled.
        rises: Whether the claim is "higher"; otherwise "lower".
    """
    if not scores or not others:
        return Verdict(None, None, "undecided")
    difference = statistics.fmean(scores) - statistics.fmean(others)
    deviation, degrees_of_freedom = pooled_deviation(groups)
    if min(len(scores), len(others)) < _MIN_SEEDS:
        return Verdict(difference, None, "undecided")
    quantile = _T95[min(degrees_of_freedom, len(_T95)) - 1]
    interval = quantile * deviation * math.sqrt(1 / len(scores) + 1 / len(others))
    if abs(difference) <= interval:
        return Verdict(difference, interval, "undecided")
    return Verdict(difference, interval, "agrees" if (difference > 0) == rises else "disagrees")
