"""Compare one quantity of matched stems: bias, scatter and how well the stated errors hold."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from basetree.arrays import Float
from basetree.normal import NORMAL_975
from edgetree.check.comparison import Comparison
from edgetree.check.gross import GrossError, find_gross_errors, shifted_rows
from edgetree.check.matching import Pair
from edgetree.measure import Failure

OUTLIER_STDS: Final = 3.0
"""An error is an outlier from this many of its standard deviations on."""


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


class NotMeasured(NamedTuple):
    """A matched stem with a reading of the caliper, but without a measured value."""

    pair: Pair
    reason: str


@dataclass(frozen=True)
class QuantityCheck:
    """The comparison of one quantity. Errors are measured minus caliper, in metres.

    Attributes:
        quantity: Its key in `TreeMeasurement`, such as "diameter_m".
        comparisons: The stems with both values, at least one, without gross errors.
        not_measured: The stems with a reading of the caliper only.
        gross_errors: The stems with both values that are left out.
        shifted: By how many rows the caliper's readings seem to be shifted; 0 if they are not.
    """

    quantity: str
    comparisons: tuple[Comparison, ...]
    not_measured: tuple[NotMeasured, ...]
    gross_errors: tuple[GrossError, ...] = ()
    shifted: int = 0

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
        """How many of the 95 % intervals hold the caliper's value.

        Gross errors that the caliper's table does not explain count as not held.
        """
        unexplained = sum(not each.mistyped for each in self.gross_errors)
        inside = sum(each.covered for each in self.comparisons)
        return Share(inside, len(self.comparisons) + unexplained)

    @property
    def mean_squared_standardised_error(self) -> float:
        """Mean of (error / its standard deviation)²; 1 if the stated errors are right."""
        return float(np.mean([each.standardised**2 for each in self.comparisons]))

    @property
    def outliers(self) -> list[Comparison]:
        """The stems with an error of more than `OUTLIER_STDS` standard deviations."""
        return [each for each in self.comparisons if abs(each.standardised) > OUTLIER_STDS]


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
    if comparisons and quantity == "cut_height_m":
        return QuantityCheck(quantity, tuple(comparisons), tuple(not_measured))
    if comparisons:
        gross = find_gross_errors(comparisons)
        left_out = {id(each.comparison) for each in gross}
        kept = [each for each in comparisons if id(each) not in left_out]
        if not kept:
            return Failure(f"all {len(gross)} readings look wrong, the first: {gross[0].cause}")
        return QuantityCheck(
            quantity, tuple(kept), tuple(not_measured), tuple(gross), shifted_rows(comparisons)
        )
    if not_measured:
        reason = not_measured[0].reason
        return Failure(f"not measured on any of {len(not_measured)} stems, the first: {reason}")
    return Failure("no reading of the caliper")
