"""Quantiles of the standard normal distribution, with which errors are stated."""

from __future__ import annotations

from typing import Final

NORMAL_975: Final = 1.96
"""The 97.5 % quantile: a 95 % interval reaches this many standard deviations to each side."""

MEDIAN_ABS_NORMAL: Final = 0.6745
"""The median of the absolute value."""

MAD_TO_STD: Final = 1.4826
"""The standard deviation, divided by the median of the absolute deviations from the median."""
