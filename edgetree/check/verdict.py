"""Whether a machine passes, fails, or cannot be judged from the stems at hand.

Each reason to fail is a test with a level of its own, and the levels add up to 5 %: a machine
without bias, whose stated errors are right, fails in 5 of 100 checks at most, with any number of
stems. The tests of shares are exact for any distribution of the errors with the stated quantiles.
The t-tests are exact for normal errors; with heavier tails they find less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Final, Literal, TypeAlias

import numpy as np

from basetree.arrays import Float
from basetree.counts import counted
from basetree.normal import MEDIAN_ABS_NORMAL
from edgetree.check.distributions import (
    at_least,
    exact_interval,
    fewest_unlikely,
    student_limit,
    t_test_power,
)
from edgetree.check.matching import Matching
from edgetree.check.quantities import QuantityCheck, Share

Outcome: TypeAlias = Literal["passed", "failed", "undecided"]

BIAS_LEVEL: Final = 0.025
STATED_LEVEL: Final = 0.015
TREND_LEVEL: Final = 0.005
WIDTH_LEVEL: Final = 0.0025
MISSED_LEVEL: Final = 0.0025
"""The levels of the tests, 5 % together. Each is shared by the quantities that are tested."""

TOLERATED_BIAS: Final = 0.02
"""A bias of this share of the diameter does not fail the check, however certain."""

TOLERATED_COVERAGE: Final = 0.9
"""95 % intervals that hold this share of the readings do not fail the check, however certain."""

TOLERATED_WIDTH: Final = 2.0
"""Stated errors of this many times the true ones do not fail the check."""

TOLERATED_MISSED: Final = 1 / 3
"""A machine that does not measure this share of the stems does not fail the check."""

SMALL_BIAS: Final = 0.03
"""The bias of which the report says how often it would be seen."""

LARGE_BIAS: Final = 0.05
"""A machine passes only if this bias would be seen, and stated errors of half the true ones."""

WANTED_POWER: Final = 0.8
"""How often they must be seen."""

MOST_LEFT_OUT: Final = 0.1
"""Nothing is judged if more than this share of the readings, and more than one, is left out."""

_OUTSIDE: Final = 0.05  # of a 95 % interval
_OUTSIDE_OF_HALF: Final = 0.327  # of an interval with half the standard deviation
_FEWEST_OF_TREND: Final = 10
_MOST_NEEDED: Final = 10_000


@dataclass(frozen=True)
class Power:
    """What a number of stems can show about one diameter.

    Attributes:
        stems: The stems that are compared.
        small_bias: How often a bias of `SMALL_BIAS` would be found, 0 to 1.
        large_bias: How often one of `LARGE_BIAS` would be found.
        half_stated: How often stated errors of half the true ones would be found.
        needed_small: Stems with which `small_bias` would be `WANTED_POWER`; one stem does not tell.
        needed: Stems with which the other two would be.
    """

    stems: int
    small_bias: float
    large_bias: float
    half_stated: float
    needed_small: int
    needed: int

    @property
    def enough(self) -> bool:
        """Whether the stems are enough for a machine to pass."""
        return min(self.large_bias, self.half_stated) >= WANTED_POWER


@dataclass(frozen=True)
class Verdict:
    """The outcome of a check.

    Attributes:
        problems: Why the machine fails.
        doubts: Why nothing can be judged, such as a table with many wrong readings.
        too_few: Why the stems are too few for the machine to pass; empty if they are enough.
        missed: Stems with a diameter of the caliper that the machine refused or missed.
        power: What the stems can show, by quantity.
    """

    problems: tuple[str, ...]
    doubts: tuple[str, ...]
    too_few: str
    missed: Share
    power: Mapping[str, Power]

    @property
    def outcome(self) -> Outcome:
        """Undecided if nothing can be judged, or if nothing is wrong and the stems are too few."""
        if self.doubts:
            return "undecided"
        if self.problems:
            return "failed"
        return "undecided" if self.too_few else "passed"

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the machine does not pass; empty if it does."""
        return self.doubts or self.problems or ((self.too_few,) if self.too_few else ())


def judge(quantities: Mapping[str, QuantityCheck], missed: Share) -> Verdict:
    """Judge a machine by its compared quantities, of which one is a diameter."""
    diameters = {name: each for name, each in quantities.items() if name != "cut_height_m"}
    problems, doubts = [], []
    for name, check in quantities.items():
        of_one = [_too_narrow(check, STATED_LEVEL / len(quantities))]
        of_one.append(_too_wide(check, WIDTH_LEVEL / len(quantities)))
        if name in diameters:
            of_one.insert(0, _biased(check, BIAS_LEVEL / len(diameters)))
            of_one += _trends(check, TREND_LEVEL / 2 / len(diameters))
            doubts += [f"{_words(name)}: {doubt}" for doubt in _doubts(check)]
        problems += [f"{_words(name)}: {problem}" for problem in of_one if problem]
    problems += _too_many_missed(missed)
    level = BIAS_LEVEL / len(diameters), STATED_LEVEL / len(quantities)
    power = {name: _power(check, *level) for name, check in diameters.items()}
    best = max(power, key=lambda name: power[name].stems)
    few = "" if power[best].enough else f"{_words(best)}: {_few(power[best])}"
    return Verdict(tuple(problems), tuple(doubts), few, missed, power)


def missed_stems(matching: Matching) -> Share:
    """How many stems have a diameter of the caliper, and none of the machine to compare it with.

    Stems with ambiguous positions do not count.
    """
    wanted = [
        (pair.measured, set(pair.caliper.values) - {"cut_height_m"}) for pair in matching.pairs
    ]
    refused = [names and not any(stem.values[name] for name in names) for stem, names in wanted]
    alone = [stem for stem in matching.caliper_only if set(stem.values) - {"cut_height_m"}]
    total = sum(bool(names) for _, names in wanted) + len(alone)
    return Share(sum(map(bool, refused)) + len(alone), max(total, 1))


def relative_errors(check: QuantityCheck) -> Float:
    """(N,) errors divided by the caliper's diameters."""
    return np.array([each.error.value / each.caliper.value for each in check.comparisons])


def bias_interval(check: QuantityCheck, level: float = 0.05) -> tuple[float, float]:
    """The interval of the mean relative error (Student's t); infinite for one stem."""
    errors = relative_errors(check)
    if len(errors) < 2:
        return -math.inf, math.inf
    reach = student_limit(level, len(errors) - 1) * errors.std(ddof=1) / math.sqrt(len(errors))
    return float(errors.mean() - reach), float(errors.mean() + reach)


def _words(quantity: str) -> str:
    return quantity.removesuffix("_m").replace("_", " ")


def _biased(check: QuantityCheck, level: float) -> str:
    low, high = bias_interval(check, level)
    bias = float(relative_errors(check).mean())
    if low <= 0 <= high or abs(bias) <= TOLERATED_BIAS:
        return ""
    low, high = bias_interval(check)
    return (
        f"the bias of {bias * 100:+.1f} % (95 % interval {low * 100:+.1f} to {high * 100:+.1f} %)"
        f" is no chance, and more than {TOLERATED_BIAS * 100:g} %"
    )


def _too_narrow(check: QuantityCheck, level: float) -> str:
    coverage = check.coverage
    outside = coverage.total - coverage.count
    if coverage.value >= TOLERATED_COVERAGE or at_least(outside, coverage.total, _OUTSIDE) > level:
        return ""
    return (
        f"the 95 % intervals hold {coverage.count} of {coverage.total} values, clearly less than"
        " 95 %"
    )


def _too_wide(check: QuantityCheck, level: float) -> str:
    size = np.array([abs(each.standardised) for each in check.comparisons])
    inside = int(np.count_nonzero(size < MEDIAN_ABS_NORMAL / TOLERATED_WIDTH))
    if at_least(inside, check.coverage.total, 0.5) > level:
        return ""
    stated_cm = float(np.median([each.error.std for each in check.comparisons])) * 100
    useful_cm = stated_cm * float(np.median(size)) / MEDIAN_ABS_NORMAL
    return (
        f"the stated errors are more than {TOLERATED_WIDTH:g} times the true ones: they are"
        f" typically ± {stated_cm:.1f} cm, and ± {useful_cm:.1f} cm would do"
    )


def _trends(check: QuantityCheck, level: float) -> list[str]:
    """Whether the relative error grows with the diameter, or with the distance."""
    errors = relative_errors(check)
    sizes_m = np.array([each.caliper.value for each in check.comparisons])
    points_m = [each.pair.measured.point_camera_m for each in check.comparisons]
    found = [_trend(errors, np.log(sizes_m), "diameter", level)]
    if all(point is not None for point in points_m):
        away_m = np.linalg.norm(np.array(points_m, float), axis=1)
        found.append(_trend(errors, away_m, "distance", level))
    return found


def _trend(errors: Float, along: Float, what: str, level: float) -> str:
    """A slope that is no chance, by its deviation that also holds for unequal errors (HC3)."""
    count, offset, extent = len(errors), along - along.mean(), float(along.std())
    if count < _FEWEST_OF_TREND or extent <= 1e-6 * max(float(np.abs(along).max()), 1):
        return ""
    weight = offset / (offset**2).sum()
    slope = float(weight @ errors)
    left = errors - errors.mean() - slope * offset
    leverage = np.minimum(1 / count + offset * weight, 0.99)
    std = math.sqrt(float(((weight * left / (1 - leverage)) ** 2).sum()))
    if abs(slope) <= student_limit(level, count - 2) * std or abs(slope) * extent <= TOLERATED_BIAS:
        return ""
    low, high = (errors.mean() + sign * slope * extent for sign in (-1, 1))
    ends = ("thin stems", "thick ones") if what == "diameter" else ("near stems", "far ones")
    return (
        f"the bias changes with the {what}, from {low * 100:+.1f} % for {ends[0]} to"
        f" {high * 100:+.1f} % for {ends[1]}"
    )


def _too_many_missed(missed: Share) -> list[str]:
    if at_least(missed.count, missed.total, TOLERATED_MISSED) > MISSED_LEVEL:
        return []
    low, high = exact_interval(missed.count, missed.total)
    return [
        f"{missed.count} of {missed.total} stems have no diameter of the machine (in the long run"
        f" {low * 100:.0f} to {high * 100:.0f} %), more than a third"
    ]


def _doubts(check: QuantityCheck) -> list[str]:
    if check.shifted:
        where = "down" if check.shifted > 0 else "up"
        return [
            "cannot be judged: the caliper's readings fit if they are moved"
            f" {where} by one row; correct the table"
        ]
    out = len(check.gross_errors)
    total = out + len(check.comparisons)
    if out > max(1, MOST_LEFT_OUT * total):
        return [f"cannot be judged: {out} of {total} readings look wrong; correct the table"]
    return []


def _power(check: QuantityCheck, bias_level: float, stated_level: float) -> Power:
    errors = relative_errors(check)
    count = len(errors)
    std = float(errors.std(ddof=1)) if count > 1 else math.inf

    def bias(share: float, stems: int) -> float:
        known = stems > 1 and math.isfinite(std)
        return t_test_power(share, std, stems, bias_level, TOLERATED_BIAS) if known else 0.0

    half = partial(_half_stated_power, stated_level)

    def both(stems: int) -> float:
        # One stem does not show how its errors scatter, so nothing tells yet what a bias needs.
        return min(bias(LARGE_BIAS, stems), half(stems)) if count > 1 else half(stems)

    powers = bias(SMALL_BIAS, count), bias(LARGE_BIAS, count), half(count)
    return Power(
        count,
        *powers,
        _needed(count, powers[0], lambda stems: bias(SMALL_BIAS, stems)),
        _needed(count, min(powers[1:]), both),
    )


@lru_cache(maxsize=4096)
def _half_stated_power(level: float, stems: int) -> float:
    return at_least(fewest_unlikely(stems, _OUTSIDE, level), stems, _OUTSIDE_OF_HALF)


def _needed(stems: int, power: float, at: Callable[[int], float]) -> int:
    """The stems with which a power is `WANTED_POWER`; `stems` if they are enough."""
    if power >= WANTED_POWER:
        return stems
    low, high = stems, 2 * stems
    while at(high) < WANTED_POWER and high < _MOST_NEEDED:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if at(middle) >= WANTED_POWER else (middle, high)
    return min(high, _MOST_NEEDED)


def _few(power: Power) -> str:
    verb = "is" if power.stems == 1 else "are"
    return (
        f"{counted(power.stems, 'stem')} {verb} too few to tell: a bias of"
        f" {LARGE_BIAS * 100:g} % would be seen in {power.large_bias * 100:.0f} of 100 cases,"
        f" stated errors of half the true ones in {power.half_stated * 100:.0f}; measure about"
        f" {power.needed} stems"
    )
