"""Heights above ground that plants or snow with an even top may hide.

The depth of an even top is that of ground. What is left is the height itself: the cut lies above
the soil, and stumps are about as high as `STUMP_MEAN_M`. So the lower a cut comes out, the more
likely it is that something stands on the soil.
"""

from __future__ import annotations

import math

import numpy as np

from basetree.arrays import Float
from edgetree.measure.constants.ground import (
    EVEN_COVER_MEAN_M,
    EVEN_COVER_SHARE,
    STUMP_MEAN_M,
)
from edgetree.measure.estimates import Estimate

_STEP_M = 0.02
_DEPTHS_M = np.arange(_STEP_M / 2, 1.2, _STEP_M)


def above_soil(height: Estimate) -> Estimate:
    """The height above a surface, given that the surface is not below the soil.

    The value is the mean of a normal distribution that is cut off at 0. A surface hides the soil
    with the probability `EVEN_COVER_SHARE` before the height is seen; Bayes' rule weighs both
    cases by how common stumps of that height are, and the spread of what may be hidden is added to
    the standard deviation.

    Args:
        height: Height above the surface and its standard deviation, in metres.
    """
    reach = height.value / height.std
    density = math.exp(-(reach**2) / 2) / math.sqrt(2 * math.pi)
    lift = density / max(math.erfc(-reach / math.sqrt(2)) / 2, 1e-12)
    variance = height.std**2 * max(1 - lift * (reach + lift), 0.0)
    value = height.value + lift * height.std
    return Estimate(value, math.sqrt(variance + hidden_std_m(value) ** 2))


def hidden_std_m(height_m: float) -> float:
    """Standard deviation of the soil's height below an even surface, in metres.

    Args:
        height_m: Height of the cut above the surface, above 0.
    """
    covered = np.exp(-_DEPTHS_M / EVEN_COVER_MEAN_M) * _stumps(height_m + _DEPTHS_M)
    covered *= EVEN_COVER_SHARE / EVEN_COVER_MEAN_M * _STEP_M
    bare = (1 - EVEN_COVER_SHARE) * float(_stumps(np.array(height_m)))
    total = bare + float(covered.sum())
    return math.sqrt(float(covered @ _DEPTHS_M**2) / total)


def _stumps(height_m: Float) -> Float:
    """Densities of the heights of stumps, but for a factor: a gamma distribution of shape 4."""
    share = 4 * height_m / STUMP_MEAN_M
    return np.asarray(share**3 * np.exp(-share))
