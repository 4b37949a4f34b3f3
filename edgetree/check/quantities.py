"""Compare one quantity of matched stems: bias, scatter and how well the stated errors hold."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from basetree.arrays import Float
from basetree.normal import NORMAL_975
from edgetree.check.matching import Pair
from edgetree.measure import Estimate, Failure

MIN_COVERAGE: Final = 0.9
"""The check fails if the 95 % intervals hold clearly less than this share of the readings."""

BIAS_STDS: Final = 3.0
"""A bias is significant from this many of its standard errors on."""

OUTLIER_STDS: Final = 3.0
"""An error is an outlier from this many of its standard deviations on."""

# A significant bias of less than this share of the mean diameter does not fail the check.
_BIAS_SHARE: Final = 0.02


@dataclass(frozen=True)
class Share:
    """A share of cases.

    Attributes:
        count: The cases that count.
        total: All cases, at least one.
    """

    count: int
    total: int

    @property
    def value(self) -> float:
        """The share, 0 to 1."""
        return self.count / self.total

    @property
    def interval95(self) -> tuple[float, float]:
        """The 95 % confidence interval of the true share.

        The score interval of Wilson (1927, Probable inference, the law of succession, and
        statistical inference), which also holds for few cases.
        """
        squared, total, share = NORMAL_975**2, self.total, self.value
        centre = share + squared / (2 * total)
        reach = NORMAL_975 * math.sqrt(share * (1 - share) / total + squared / (4 * total * total))
        scale = 1 + squared / total
        return max((centre - reach) / scale, 0.0), min((centre + reach) / scale, 1.0)


class Comparison(NamedTuple):
    """One quantity of one stem, measured by the machine and by the caliper."""

    pair: Pair
    measured: Estimate
    caliper: Estimate

    @property
    def error(self) -> Estimate:
        """Measured minus caliper, with the standard deviation of both together."""
        std = math.hypot(self.measured.std, self.caliper.std)
        return Estimate(self.measured.value - self.caliper.value, std)

    @property
    def standardised(self) -> float:
        """The error in its standard deviations."""
        return self.error.value / self.error.std

    @property
    def covered(self) -> bool:
        """Whether the 95 % interval holds the caliper's value."""
        low, high = self.error.interval95
        return bool(low <= 0 <= high)


class NotMeasured(NamedTuple):
    """A matched stem with a reading of the caliper, but without a measured value."""

    pair: Pair
    reason: str


@dataclass(frozen=True)
class QuantityCheck:
    """The comparison of one quantity. Errors are measured minus caliper, in metres.

    Attributes:
        quantity: Its key in `TreeMeasurement`, such as "diameter_m".
        comparisons: The stems with both values, at least one.
        not_measured: The stems with a reading of the caliper only.
    """

    quantity: str
    comparisons: tuple[Comparison, ...]
    not_measured: tuple[NotMeasured, ...]

    @cached_property
    def errors_m(self) -> Float:
        """(N,) errors."""
        return np.array([each.error.value for each in self.comparisons])

    @property
    def mean_m(self) -> float:
        """Mean of the caliper's values."""
        return float(np.mean([each.caliper.value for each in self.comparisons]))

    @property
    def bias_m(self) -> float:
        """Mean error."""
        return float(self.errors_m.mean())

    @property
    def bias_std_m(self) -> float | None:
        """Standard error of the bias, from the scatter of the errors; None for one stem."""
        count = len(self.errors_m)
        return float(self.errors_m.std(ddof=1)) / math.sqrt(count) if count > 1 else None

    @property
    def rmse_m(self) -> float:
        """Root mean square error."""
        return float(np.sqrt((self.errors_m**2).mean()))

    @property
    def rmse_share(self) -> float | None:
        """The root mean square error divided by the mean of the caliper's values."""
        return self.rmse_m / self.mean_m if self.mean_m > 0 else None

    @property
    def median_abs_error_m(self) -> float:
        """Median of the absolute errors."""
        return float(np.median(np.abs(self.errors_m)))

    @property
    def median_ratio(self) -> float:
        """Median of the measured values divided by the median of the caliper's; 1 if that is 0."""
        measured = float(np.median([each.measured.value for each in self.comparisons]))
        caliper = float(np.median([each.caliper.value for each in self.comparisons]))
        return measured / caliper if caliper > 0 else 1.0

    @property
    def coverage(self) -> Share:
        """How many of the 95 % intervals hold the caliper's value."""
        return Share(sum(each.covered for each in self.comparisons), len(self.comparisons))

    @property
    def mean_squared_standardised_error(self) -> float:
        """Mean of (error / its standard deviation)²; 1 if the stated errors are right."""
        return float(np.mean([each.standardised**2 for each in self.comparisons]))

    @property
    def outliers(self) -> list[Comparison]:
        """The stems with an error of more than `OUTLIER_STDS` standard deviations."""
        return [each for each in self.comparisons if abs(each.standardised) > OUTLIER_STDS]

    def problems(self) -> list[str]:
        """Why the check fails for this quantity; empty if it passes.

        It fails if the Wilson interval of the coverage lies below `MIN_COVERAGE`. For diameters it
        also fails if the bias is more than `BIAS_STDS` standard errors and more than 2 % of the
        mean diameter.
        """
        found = []
        name, coverage = self.quantity.removesuffix("_m").replace("_", " "), self.coverage
        if coverage.interval95[1] < MIN_COVERAGE:
            found.append(
                f"{name}: the 95 % intervals hold {coverage.count} of {coverage.total} values,"
                f" clearly less than {MIN_COVERAGE * 100:g} %"
            )
        bias_m, std_m = self.bias_m, self.bias_std_m
        if (
            self.quantity != "cut_height_m"
            and std_m is not None
            and abs(bias_m) > BIAS_STDS * std_m
            and abs(bias_m) > _BIAS_SHARE * self.mean_m
        ):
            found.append(
                f"{name}: the bias of {bias_m * 100:+.1f} cm is more than {BIAS_STDS:g} standard"
                f" errors and {_BIAS_SHARE * 100:g} % of the mean"
            )
        return found


def check_quantity(quantity: str, pairs: tuple[Pair, ...]) -> QuantityCheck | Failure:
    """Compare one quantity of matched stems.

    Args:
        quantity: Its key in `TreeMeasurement`.
        pairs: The matched stems.

    Returns:
        The comparison, or the reason why no stem has both values.
    """
    comparisons, not_measured = [], []
    for pair in pairs:
        caliper, measured = pair.caliper.values.get(quantity), pair.measured.values[quantity]
        if caliper is None:
            continue
        if isinstance(measured, Failure):
            not_measured.append(NotMeasured(pair, measured.reason))
        else:
            comparisons.append(Comparison(pair, measured, caliper))
    if comparisons:
        return QuantityCheck(quantity, tuple(comparisons), tuple(not_measured))
    if not_measured:
        reason = not_measured[0].reason
        return Failure(f"not measured on any of {len(not_measured)} stems, the first: {reason}")
    return Failure("no reading of the caliper")
