"""By how much the times of a benchmark vary without a cause."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median
from typing import Final

import numpy as np

LEAST_SHARE: Final = 0.03
"""Smallest change of a time that counts, as a share of it."""


def noise_of(times_ms: Sequence[float]) -> float:
    """About 2.7 standard deviations of the median of the rounds, as a share of it.

    The standard deviation of a median of n normal values is 0.93 times the range of their middle
    half, divided by the root of n.
    """
    low, high = np.percentile(times_ms, (25, 75))
    return 2.5 * float(high - low) / math.sqrt(len(times_ms)) / median(times_ms)
