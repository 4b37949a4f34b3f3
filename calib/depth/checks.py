"""Whether an array can be a depth map in metres, before anything is measured in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.errors import DepthError

_FARTHEST_MEDIAN_M = 60.0
_NEAREST_MEDIAN_M = 0.05
_LARGEST_SHARE_AT_MAXIMUM = 0.5
_ENOUGH = 50_000


@dataclass(frozen=True)
class DepthReport:
    """A usable depth map: the share of pixels with a reading, and the readings' metres."""

    valid_share: float
    nearest_m: float
    median_m: float
    farthest_m: float


@dataclass(frozen=True)
class DepthFailure:
    """No usable depth map, and why. Falsy."""

    reason: str

    def __bool__(self) -> bool:
        return False


def check_depth(depth_m: NDArray[Any], min_share: float = 0.05) -> DepthReport | DepthFailure:
    """What an (H, W) float array holds, or why it is no depth map in metres.

    A reading is finite and above 0. Fewer than ``min_share`` of the pixels, one and the same value,
    a sensor at its limit and the median of another unit are failures. Of a large map every n-th
    reading is looked at.
    """
    if depth_m.ndim != 2 or depth_m.size == 0:
        return DepthFailure(f"the depth map has shape {depth_m.shape}: expected (H, W)")
    if not np.issubdtype(depth_m.dtype, np.floating):
        return DepthFailure(
            f"the depth map is {depth_m.dtype}: expected metres as float32, which read_depth gives"
        )
    seen = depth_m.ravel()[:: max(1, depth_m.size // _ENOUGH)]
    readings = seen[np.isfinite(seen) & (seen > 0)]
    share = readings.size / seen.size
    if share < min_share or readings.size == 0:
        return DepthFailure(f"{share:.1%} of the pixels have depth: expected {min_share:.1%}")
    nearest, median, farthest = (float(value) for value in np.quantile(readings, [0, 0.5, 1]))
    reason = _implausible(nearest, median, farthest, float((readings == readings.max()).mean()))
    return DepthFailure(reason) if reason else DepthReport(share, nearest, median, farthest)


def _implausible(nearest: float, median: float, farthest: float, at_maximum: float) -> str:
    """What no scene looks like; empty where nothing speaks against the readings."""
    if nearest == farthest:
        return f"every reading is {farthest:g} m: expected different depths"
    if at_maximum > _LARGEST_SHARE_AT_MAXIMUM:
        return f"{at_maximum:.0%} of the readings are the largest, {farthest:g} m: saturated"
    if median > _FARTHEST_MEDIAN_M:
        return (
            f"the median depth is {median:g} m: expected metres; the values look like"
            " millimetres, to be read with a scale of 0.001"
        )
    if median < _NEAREST_MEDIAN_M:
        return (
            f"the median depth is {median:g} m: expected metres; the values look like metres"
            " that were read as millimetres"
        )
    return ""


def mask_by_confidence(
    depth_m: NDArray[np.floating[Any]], confidence: NDArray[Any], least: float
) -> NDArray[np.float32]:
    """(H, W) metres without the readings whose (H, W) confidence is below ``least``.

    For sensors whose confidence rises with trust. Raises DepthError where the sizes differ.
    """
    if confidence.shape != depth_m.shape:
        raise DepthError(
            f"the confidence has shape {confidence.shape}: expected the depth map's {depth_m.shape}"
        )
    return np.where(confidence >= least, depth_m, 0).astype(np.float32)
