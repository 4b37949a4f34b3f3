"""One quantity of one stem, measured by the machine and by the caliper."""

from __future__ import annotations

import math
from typing import NamedTuple

from edgetree.check.matching import Pair
from edgetree.measure import Estimate


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
