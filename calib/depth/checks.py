"""Check that an array is a plausible depth map in metres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, Float32
from calib.errors import DepthError, Failure

_MAX_MEDIAN_M = 60.0
_MIN_MEDIAN_M = 0.05
_MAX_SHARE_AT_MAXIMUM = 0.5
_SAMPLED_PIXELS = 50_000
_LEAST_SAMPLED = 1000  # readings; with fewer in the sample the whole map is looked at
_MORE_THAN_A_STEM = 0.05  # a smaller share may be one thin stem, at one distance


@dataclass(frozen=True)
class DepthReport:
    """Statistics of a plausible depth map.

    Attributes:
        valid_share: Share of the pixels that have a reading, 0 to 1.
        nearest_m: Smallest reading.
        median_m: Median of the readings.
        farthest_m: Largest reading.
    """

    valid_share: float
    nearest_m: float
    median_m: float
    farthest_m: float


class DepthFailure(Failure):
    """The reason why an array is not a plausible depth map. Falsy."""


def check_depth(depth_m: NDArray[Any], min_share: float = 0.0) -> DepthReport | DepthFailure:
    """Check that an array is a plausible depth map in metres.

    A reading is a finite value above 0. Large maps with many readings are subsampled. Few readings
    may be all that a thin stem before the sky gives, and are no fault by themselves.

    Args:
        depth_m: (H, W) floating-point array.
        min_share: Smallest accepted share of pixels with a reading.

    Returns:
        A DepthReport, or a falsy DepthFailure if there are too few readings, if those of more than
        a twentieth of the map are all equal or more than half are saturated at the largest value,
        or if the median suggests another unit.

    Examples:
        >>> import numpy as np
        >>> check_depth(np.zeros((48, 64), np.float32)).reason
        'no pixel has depth: expected readings'
    """
    if depth_m.ndim != 2 or depth_m.size == 0:
        return DepthFailure(f"the depth map has shape {depth_m.shape}: expected (H, W)")
    if not np.issubdtype(depth_m.dtype, np.floating):
        return DepthFailure(
            f"the depth map is {depth_m.dtype}: expected metres as float32, which read_depth gives"
        )
    share, readings = _readings(depth_m.ravel()[:: max(1, depth_m.size // _SAMPLED_PIXELS)])
    if readings.size < _LEAST_SAMPLED:
        share, readings = _readings(depth_m.ravel())
    if readings.size == 0:
        return DepthFailure("no pixel has depth: expected readings")
    if share < min_share:
        return DepthFailure(f"{share:.2%} of the pixels have depth: expected {min_share:.2%}")
    nearest, median, farthest = (float(value) for value in np.quantile(readings, [0, 0.5, 1]))
    at_maximum = float((readings == readings.max()).mean())
    if share < _MORE_THAN_A_STEM:
        at_maximum = 0.0
    reason = _implausible(nearest, median, farthest, at_maximum)
    return DepthFailure(reason) if reason else DepthReport(share, nearest, median, farthest)


def _readings(values: NDArray[Any]) -> tuple[float, NDArray[Any]]:
    """Return the share of readings among values, and the readings."""
    readings = values[np.isfinite(values) & (values > 0)]
    return readings.size / values.size, readings


def _implausible(nearest: float, median: float, farthest: float, at_maximum: float) -> str:
    """Return why the readings are implausible, or an empty string."""
    if nearest == farthest and at_maximum:
        return f"every reading is {farthest:g} m: expected different depths"
    if at_maximum > _MAX_SHARE_AT_MAXIMUM:
        return f"{at_maximum:.0%} of the readings are the largest, {farthest:g} m: saturated"
    if median > _MAX_MEDIAN_M:
        return (
            f"the median depth is {median:g} m: expected metres; the values look like"
            " millimetres, to be read with a scale of 0.001"
        )
    if median < _MIN_MEDIAN_M:
        return (
            f"the median depth is {median:g} m: expected metres; the values look like metres"
            " that were read as millimetres"
        )
    return ""


def mask_by_confidence(depth_m: Float, confidence: NDArray[Any], least: float) -> Float32:
    """Set readings with low confidence to 0.

    Args:
        depth_m: (H, W) metres.
        confidence: (H, W) confidence map in which larger values are more reliable.
        least: Smallest confidence that keeps a reading.

    Returns:
        (H, W) float32 metres.

    Raises:
        DepthError: If the two shapes differ.
    """
    if confidence.shape != depth_m.shape:
        raise DepthError(
            f"the confidence has shape {confidence.shape}: expected the depth map's {depth_m.shape}"
        )
    return np.where(confidence >= least, depth_m, 0).astype(np.float32)
