"""Tell from the feet of a frame's stems whether its depth is of an earlier moment.

If the machine drove ahead or back since the depth was taken, all stems come out too far away or too
near by the same length, while the ground that passes below the camera looks the same. So one length
explains all feet of a frame, where a mask that ends too early or something in front of a stem moves
one of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from basetree.arrays import Float
from edgetree.measure.constants.ground import (
    LATE_DEPTH_BESIDE_SHARE,
    LATE_DEPTH_SHARE,
    LATE_DEPTH_STD_M,
    MIN_LATE_PROBABILITY,
)

# Lengths that are compared, in metres, and the density of a foot that is moved by something else.
_LENGTHS_M = np.linspace(-1.5, 1.5, 121)
_OTHER_DENSITY = 1 / 3.0
_PRIOR = np.exp(-((_LENGTHS_M / LATE_DEPTH_STD_M) ** 2) / 2)
_PRIOR /= _PRIOR.sum()


class LateDepth(NamedTuple):
    """By how much the depth of a frame is of an earlier moment.

    Attributes:
        probability: Probability that it is.
        beyond_m: Expected length by which all stems are too far away if it is; negative where they
            are too near.
        size_m: Root mean square of the shift, which may be none.
    """

    probability: float
    beyond_m: float
    size_m: float

    @property
    def expected_m(self) -> float:
        """By how much all stems are taken to be too far away: the mean of both cases.

        It is 0 where the depth is more likely of the same moment as its picture.
        """
        return self.probability * self.beyond_m if self.probability > 0.5 else 0.0

    @property
    def std_m(self) -> float:
        """Standard deviation of the distances that are corrected by this."""
        return math.sqrt(max(self.size_m**2 - self.expected_m**2, 0.0))


def late_depth(beyond_m: Float, std_m: Float, other: Float, beside: bool) -> LateDepth:
    """The posterior of a common shift of the depth, by Bayes' rule.

    Without a shift, a foot is where its stem is, within its deviation, or moved by something else,
    anywhere within 1.5 m. With a shift, the same holds for the shifted foot. The shift has a normal
    distribution with `LATE_DEPTH_STD_M` before the feet are seen.

    Args:
        beyond_m: (N,) distances of stems by their depth less those by their feet.
        std_m: (N,) their standard deviations.
        other: (N,) probabilities that something else moves the foot.
        beside: Whether the depth lies beside the picture, which a turn of the machine does too.

    Returns:
        The shift; none if it is less probable than `MIN_LATE_PROBABILITY`, or no foot is seen.
    """
    shifts_m = np.append(_LENGTHS_M, 0.0)
    off = (beyond_m[:, None] - shifts_m) / std_m[:, None]
    near = np.exp(-(off**2) / 2) / (np.sqrt(2 * np.pi) * std_m[:, None])
    log = np.log((1 - other[:, None]) * near + other[:, None] * _OTHER_DENSITY).sum(0)
    weight = _PRIOR * np.exp(log[:-1] - log[-1])
    factor = float(weight.sum())
    share = LATE_DEPTH_BESIDE_SHARE if beside else LATE_DEPTH_SHARE
    probability = share * factor / (share * factor + 1 - share)
    if probability < MIN_LATE_PROBABILITY or not len(beyond_m):
        return LateDepth(0.0, 0.0, 0.0)
    mean_m, square_m2 = (float(weight @ _LENGTHS_M**power) / factor for power in (1, 2))
    return LateDepth(probability, mean_m, float(np.sqrt(probability * square_m2)))
