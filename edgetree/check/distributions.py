"""Exact tests for few stems: Student's t, the binomial distribution, and the power of a t-test."""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist
from typing import Final

import numpy as np

from basetree.arrays import Float64

_STEPS: Final = 5_001
_SPREAD_STEPS: Final = 101
_HALVINGS: Final = 50


@lru_cache(maxsize=4096)
def student_limit(level: float, dof: int) -> float:
    """The size of Student's t that is exceeded, on either side, with the probability `level`.

    With t = sqrt(dof) tan(angle), the density of the angle is cos(angle)^(dof - 1).
    """
    angle = np.linspace(0, math.pi / 2, _STEPS)
    density = np.cos(angle) ** (dof - 1)
    beyond = np.concatenate([[0.0], np.cumsum((density[:0:-1] + density[-2::-1]) / 2)])
    return math.sqrt(dof) * math.tan(float(np.interp(level, beyond / beyond[-1], angle[::-1])))


def at_least(count: int, total: int, probability: float) -> float:
    """The probability of `count` cases or more among `total` independent ones."""
    if count <= 0 or probability >= 1:
        return 1.0
    if count > total or probability <= 0:
        return 0.0
    return float(min(_binomial(total, probability)[count:].sum(), 1.0))


def fewest_unlikely(total: int, probability: float, level: float) -> int:
    """The smallest number of cases for which `at_least` is `level` or less; may be total + 1."""
    tail = np.cumsum(_binomial(total, probability)[::-1])[::-1]
    return int(np.count_nonzero(tail > level))


def _binomial(total: int, probability: float) -> Float64:
    """(total + 1,) probabilities of each number of cases."""
    logs = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, total + 1)))])
    count = np.arange(total + 1)
    chosen = logs[total] - logs - logs[::-1]
    of_each = count * math.log(probability) + (total - count) * math.log1p(-probability)
    return np.asarray(np.exp(chosen + of_each))


def exact_interval(count: int, total: int, level: float = 0.05) -> tuple[float, float]:
    """The interval of a share by Clopper and Pearson (1934), which errs in `level` at most."""
    low = 0.0 if count == 0 else _share_where(count, total, level / 2)
    high = 1.0 if count == total else 1 - _share_where(total - count, total, level / 2)
    return low, high


def _share_where(count: int, total: int, level: float) -> float:
    """The share at which `count` cases or more have the probability `level`."""
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if at_least(count, total, middle) < level else (low, middle)
    return (low + high) / 2


def t_test_power(
    shift: float, std: float, count: int, level: float, tolerance: float = 0.0
) -> float:
    """How often a t-test finds a shift, exactly for normal errors.

    Args:
        shift: The true mean.
        std: The true standard deviation of one value.
        count: Number of values, at least 2.
        level: The test's level, both sides together.
        tolerance: A mean of this size or less is not found, however certain.
    """
    dof = count - 1
    reach = 6 / math.sqrt(2 * dof)
    spread = np.linspace(max(1 - reach, 1e-6), 1 + reach, _SPREAD_STEPS)
    weight = np.exp((dof - 1) * np.log(spread) - dof * (spread**2 - 1) / 2)  # of chi
    error = max(std / math.sqrt(count), 1e-12)
    limit = np.maximum(student_limit(level, dof) * spread * error, tolerance)
    cdf = NormalDist().cdf
    found = [cdf((shift - each) / error) + cdf((-shift - each) / error) for each in limit]
    return float(np.average(found, weights=weight))
