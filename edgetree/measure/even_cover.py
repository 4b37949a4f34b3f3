"""Heights above ground that plants or snow with an even top may hide.

The depth of an even top is that of ground. What is left is the height itself: the cut lies above
the soil, and stumps are about as high as `STUMP_MEAN_M`. So the lower a cut comes out, the more
likely it is that something stands on the soil.
"""

from __future__ import annotations

import math

from edgetree.measure.constants.ground import (
    EVEN_COVER_MEAN_M,
    EVEN_COVER_SHARE,
    STUMP_MEAN_M,
)
from edgetree.measure.estimates import Estimate

# Of a depth d of a cover under the height h, the integral of d^power (h + d)^3 exp(-c d) is a
# polynomial of h; these are its coefficients by the power, the highest first.
_RATE = 1 / EVEN_COVER_MEAN_M + 4 / STUMP_MEAN_M
_MOMENTS = {
    power: [
        math.comb(3, n) * math.factorial(n + power) / _RATE ** (n + power + 1) for n in range(4)
    ]
    for power in (0, 2)
}


def above_soil(height: Estimate, stated: bool = False) -> Estimate:
    """The height above a surface, given that the surface is not below the soil.

    The value is the mean of a normal distribution that is cut off at 0. A surface hides the soil
    with the probability `EVEN_COVER_SHARE` before the height is seen; Bayes' rule weighs both
    cases by how common stumps of that height are, and the spread of what may be hidden is added to
    the standard deviation. If the height of the cover is stated, nothing else is hidden.

    Args:
        height: Height above the surface and its standard deviation, in metres.
        stated: Whether a stated height of a cover is part of it.
    """
    reach = height.value / height.std
    density = math.exp(-(reach**2) / 2) / math.sqrt(2 * math.pi)
    lift = density / max(math.erfc(-reach / math.sqrt(2)) / 2, 1e-12)
    variance = height.std**2 * max(1 - lift * (reach + lift), 0.0)
    value = height.value + lift * height.std
    hidden_m = 0.0 if stated else hidden_std_m(value)
    return Estimate(value, math.sqrt(variance + hidden_m**2))


def hidden_std_m(height_m: float) -> float:
    """Standard deviation of the soil's height below an even surface, in metres.

    What may be hidden has an exponential distribution of mean `EVEN_COVER_MEAN_M`, and the heights
    of stumps have a gamma distribution of shape 4 and mean `STUMP_MEAN_M`. By Bayes' rule a depth d
    of cover under the height h counts with the density of the first at d times that of the second
    at h + d, which is (h + d)^3 exp(-c d) but for a factor. Its moments are sums of n! / c^(n + 1).

    Args:
        height_m: Height of the cut above the surface, at least 0.
    """
    bare = (1 - EVEN_COVER_SHARE) * height_m**3
    covered = EVEN_COVER_SHARE / EVEN_COVER_MEAN_M * _covered_moment(height_m, 0)
    squared = EVEN_COVER_SHARE / EVEN_COVER_MEAN_M * _covered_moment(height_m, 2)
    return math.sqrt(squared / (bare + covered))


def _covered_moment(height_m: float, power: int) -> float:
    """Integral of d^power (h + d)^3 exp(-c d) over all depths d of a cover."""
    cubed, squared, once, constant = _MOMENTS[power]
    return ((cubed * height_m + squared) * height_m + once) * height_m + constant
