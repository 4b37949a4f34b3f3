"""Fit the stated errors of the diameter to a machine: its scale, and the size of its errors.

Model: the measured diameter is the scale times the true one, plus a normal error whose standard
deviation is the stated one times a factor. Both are fitted with weights that limit the influence of
outliers: Huber's M-estimate of location and his proposal 2 for the scale (Huber 1964, Robust
estimation of a location parameter).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from basetree.arrays import Bool, Float
from basetree.normal import MEDIAN_ABS_NORMAL, NORMAL_975
from edgetree.check.comparison import Comparison
from edgetree.check.quantities import Share
from edgetree.measure import Estimate, Failure, MeasureSettings

BIAS_STDS: Final = 3.0
"""A scale is significant from this many of its standard deviations on."""

MIN_STEMS: Final = 20
"""Fewest stems for a fit: the factor is then known to about 17 %."""

FITTED_SETTINGS: Final = (
    "keypoint_std_px",
    "keypoint_spread",
    "keypoint_heat",
    "mask_std_px",
    "mask_spread",
    "given_mask_std_px",
    "depth_bias_per_m",
    "curvature_std",
    "out_of_round_std",
    "outline_doubt",
    "readings_doubt",
    "butt_swell_std",
)
"""The fields of `MeasureSettings` that are multiplied by the factor.

They make up nearly all of a diameter's standard deviation. All are multiplied alike, so that the
sources keep their weights and the diameters their values.
"""

_CLIP: Final = 2.0  # errors beyond this many standard deviations count as this many
# For a standard normal Z: the mean and the standard deviation of min(Z², _CLIP²).
_CLIPPED_MEAN, _CLIPPED_STD = 0.92054, 1.1102
_SMALLEST_FACTOR: Final = 0.05
# Of measured to true diameters, and their logarithms about the median.
_SMALLEST_RATIO: Final = 0.1
_MOST_OFF: Final = 0.5
_ITERATIONS: Final = 200
_CONVERGED: Final = 1e-5
_MAX_RELATIVE_STD: Final = 0.5
_DIGITS: Final = 4

_MOST_GROUPS: Final = 100


@dataclass(frozen=True)
class ErrorFit:
    """Scale and error factor of the diameters of a machine.

    Attributes:
        scale: Measured diameters divided by true ones, and its standard deviation.
        scale_significant: Whether it differs from 1 by more than `BIAS_STDS` standard deviations.
            Only then it is used.
        factor: True standard deviations divided by stated ones, and its standard deviation.
        factor_significant: Whether 1 is outside of its 95 % interval. Only then it is used.
        coverage_before: How many of the stated 95 % intervals hold the caliper's value.
        coverage_after: The same with scale and factor, fitted for each stem to the other stems
            (leave one out; beyond 100 stems, in 100 groups).
        settings: New values of `FITTED_SETTINGS`; empty if the factor is not significant.
    """

    scale: Estimate
    scale_significant: bool
    factor: Estimate
    factor_significant: bool
    coverage_before: Share
    coverage_after: Share
    settings: dict[str, float]


@dataclass(frozen=True, eq=False)
class _Data:
    """(N,) measured diameters, their standard deviations, and those of the caliper, in metres."""

    measured_m: Float
    measured_std_m: Float
    caliper_m: Float
    caliper_std_m: Float

    def take(self, chosen: Bool) -> _Data:
        return _Data(*(values[chosen] for values in vars(self).values()))

    def variance(self, scale: float, factor: float) -> Float:
        """(N,) variances of measured - scale x caliper."""
        caliper, measured = scale * self.caliper_std_m, factor * self.measured_std_m
        return np.asarray(caliper**2 + measured**2)

    def at_true_diameters(self) -> _Data:
        """The same with the stated deviations that measurements without an error would have.

        A stem measured too thin by a wrong distance states a smaller deviation. Weights by such
        deviations would count it more than one measured too thick, and lower the scale. How the
        deviations go with the errors is fitted.
        """
        caliper = np.log(self.caliper_m)
        off = np.log(np.maximum(self.measured_m, _SMALLEST_RATIO * self.caliper_m)) - caliper
        off = off - np.median(off)
        near = np.clip(off, -_MOST_OFF, _MOST_OFF)
        columns = np.column_stack([np.ones(len(off)), caliper, near])
        power = float(np.linalg.lstsq(columns, np.log(self.measured_std_m))[0][2])
        as_true = np.exp(-np.clip(power, 0.0, 1.0) * off)
        return replace(self, measured_std_m=self.measured_std_m * as_true)

    def covered(self, scale: float, factor: float) -> Bool:
        error = np.abs(self.measured_m - scale * self.caliper_m)
        return np.asarray(error <= NORMAL_975 * np.sqrt(self.variance(scale, factor)))


@dataclass(frozen=True)
class _Solution:
    scale: Estimate
    scale_significant: bool
    factor: Estimate
    factor_significant: bool

    @property
    def used(self) -> tuple[float, float]:
        """Scale and factor, 1 for what is not significant."""
        return (
            self.scale.value if self.scale_significant else 1.0,
            self.factor.value if self.factor_significant else 1.0,
        )


def fit_errors(
    comparisons: Sequence[Comparison], settings: MeasureSettings | None = None
) -> ErrorFit | Failure:
    """Fit scale and error factor to the diameters of matched stems.

    Args:
        comparisons: The diameters of different stems.
        settings: The settings that the stems were measured with.

    Returns:
        The fit, or the reason why there is none: fewer than `MIN_STEMS` stems, or a factor that is
        hardly known, for example because the caliper's errors are larger than the machine's.
    """
    count = len(comparisons)
    if count < MIN_STEMS:
        return Failure(f"a fit needs {MIN_STEMS} stems with a measured diameter, there are {count}")
    columns = np.array([[*each.measured, *each.caliper] for each in comparisons]).T
    data = _Data(*columns)
    solution = _solve(data)
    factor = solution.factor
    if factor.value <= _SMALLEST_FACTOR:
        return Failure("the differences are too small to fit the stated errors to")
    if factor.std > _MAX_RELATIVE_STD * factor.value:
        return Failure(
            f"the factor of {factor.value:.2f} ± {factor.std:.2f} is too uncertain: measure more"
            " stems, or with smaller errors of the caliper"
        )
    inside, groups = 0, min(count, _MOST_GROUPS)
    for group in range(groups):
        chosen = np.arange(count) % groups == group
        others = _solve(data.take(~chosen), solution)
        inside += int(data.take(chosen).covered(*others.used).sum())
    new: dict[str, Any] = {}
    if solution.factor_significant:
        base = settings or MeasureSettings()
        new = {
            name: float(f"{getattr(base, name) * solution.factor.value:.{_DIGITS}g}")
            for name in FITTED_SETTINGS
        }
        replace(base, **new)  # raises if a value is not valid
    return ErrorFit(
        scale=solution.scale,
        scale_significant=solution.scale_significant,
        factor=solution.factor,
        factor_significant=solution.factor_significant,
        coverage_before=Share(int(data.covered(1.0, 1.0).sum()), count),
        coverage_after=Share(inside, count),
        settings=new,
    )


def _solve(data: _Data, near: _Solution | None = None) -> _Solution:
    """Fit the scale, and then the factor: with this scale, or with 1 if it is not significant.

    Args:
        data: The diameters.
        near: The solution of similar data to start from.
    """
    if near is None:
        error = np.abs(data.measured_m - data.caliper_m)
        start = 1.0, float(np.median(error / data.measured_std_m)) / MEDIAN_ABS_NORMAL
    else:
        start = near.scale.value, near.factor.value
    scale, factor = _iterate(data.at_true_diameters(), start, fit_scale=True)
    significant = abs(scale.value - 1) > BIAS_STDS * scale.std
    start = (scale.value if significant else 1.0), factor.value
    _, factor = _iterate(data, start, fit_scale=False, taken=int(significant))
    reach = NORMAL_975 * factor.std / factor.value
    return _Solution(scale, significant, factor, abs(math.log(factor.value)) > reach)


def _iterate(
    data: _Data, start: tuple[float, float], *, fit_scale: bool, taken: int = 1
) -> tuple[Estimate, Estimate]:
    """Scale and factor with their standard deviations, by fixed-point iteration.

    Args:
        data: The diameters.
        start: Scale and factor to start from.
        fit_scale: Whether the scale is fitted too.
        taken: Degrees of freedom that the scale takes: 1 if it is fitted to these diameters.
    """
    count = len(data.measured_m)
    correction = count / (count - taken)
    scale, factor = start[0], max(start[1], _SMALLEST_FACTOR)
    for _ in range(_ITERATIONS):
        before = (scale, factor)
        if fit_scale:
            weights = _weights(data, scale, factor)
            scale = float(
                (weights * data.caliper_m * data.measured_m).sum()
                / (weights * data.caliper_m**2).sum()
            )
        clipped = np.minimum(_squares(data, scale, factor), _CLIP**2)
        factor *= math.sqrt(float(clipped.mean()) * correction / _CLIPPED_MEAN)
        factor = max(factor, _SMALLEST_FACTOR)
        if max(abs(scale - before[0]), abs(factor / before[1] - 1)) < _CONVERGED:
            break
    return (
        Estimate(scale, _scale_std(data, scale, factor)),
        Estimate(factor, _factor_std(data, scale, factor)),
    )


def _squares(data: _Data, scale: float, factor: float) -> Float:
    """(N,) squared standardised errors."""
    error = data.measured_m - scale * data.caliper_m
    return np.asarray(error**2 / data.variance(scale, factor))


def _weights(data: _Data, scale: float, factor: float) -> Float:
    """(N,) Huber's weights divided by the variances."""
    size = np.sqrt(_squares(data, scale, factor))
    return np.asarray(_CLIP / np.maximum(size, _CLIP) / data.variance(scale, factor))


def _scale_std(data: _Data, scale: float, factor: float) -> float:
    """Standard deviation of the scale, from the scatter of the weighted errors (sandwich form)."""
    count = len(data.measured_m)
    error = data.measured_m - scale * data.caliper_m
    pulls = _weights(data, scale, factor) * data.caliper_m * error
    within = _squares(data, scale, factor) < _CLIP**2
    slope = (within * data.caliper_m**2 / data.variance(scale, factor)).sum()
    return float(np.sqrt((pulls**2).sum() * count / (count - 1)) / slope)


def _factor_std(data: _Data, scale: float, factor: float) -> float:
    """Standard deviation of the factor (sandwich form), at least that for normal errors."""
    squares = _squares(data, scale, factor)
    clipped = np.minimum(squares, _CLIP**2)
    spread = max(float(clipped.std(ddof=1)), _CLIPPED_STD)
    # Change of the mean of `clipped` with the square of the factor.
    ratio = data.measured_std_m**2 / data.variance(scale, factor)
    slope = float((np.where(squares < _CLIP**2, squares, 0.0) * ratio).mean())
    if slope <= 0:
        return math.inf
    return spread / math.sqrt(len(squares)) / slope / (2 * factor)
