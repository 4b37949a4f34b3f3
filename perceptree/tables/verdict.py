"""Whether trainings with several seeds bear a claim out: a t-test with a pooled deviation."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

Word = Literal["agrees", "disagrees", "undecided"]

RULE = (
    "A claim is decided where the difference of the means is larger than its 95 % interval by"
    " Student's t, with the deviation between seeds pooled over all rows of the table; otherwise,"
    " and always with one seed, it is undecided. The interval says nothing of other test frames."
)

# Two-sided 95 % quantiles of Student's t at 1, 2, ... degrees of freedom; the last for all above.
_T95 = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228)
_FEWEST_SEEDS = 2


@dataclass(frozen=True)
class Verdict:
    """How much higher the first mean is, its 95 % interval (None for too few seeds), the word."""

    difference: float | None
    interval: float | None
    word: Word


def pooled_deviation(groups: Iterable[Sequence[float]]) -> tuple[float, int]:
    """The standard deviation within groups, and its degrees of freedom; (0, 0) without any."""
    several = [group for group in groups if len(group) >= _FEWEST_SEEDS]
    freedom = sum(len(group) - 1 for group in several)
    if not freedom:
        return 0.0, 0
    squares = sum((len(group) - 1) * statistics.variance(group) for group in several)
    return math.sqrt(squares / freedom), freedom


def judge(
    scores: Sequence[float],
    others: Sequence[float],
    groups: Iterable[Sequence[float]],
    rises: bool = True,
) -> Verdict:
    """Whether ``scores`` are higher than ``others`` (or lower, without ``rises``), as claimed.

    ``groups`` are the scores of all rows of the table by seed; their deviation is pooled.
    """
    if not scores or not others:
        return Verdict(None, None, "undecided")
    difference = statistics.fmean(scores) - statistics.fmean(others)
    deviation, freedom = pooled_deviation(groups)
    if min(len(scores), len(others)) < _FEWEST_SEEDS:
        return Verdict(difference, None, "undecided")
    quantile = _T95[min(freedom, len(_T95)) - 1]
    interval = quantile * deviation * math.sqrt(1 / len(scores) + 1 / len(others))
    if abs(difference) <= interval:
        return Verdict(difference, interval, "undecided")
    return Verdict(difference, interval, "agrees" if (difference > 0) == rises else "disagrees")
