"""Find the lowest place at which masks show their stems."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.regions import SearchRegions

# The lower end is looked for along three lines, in half widths, at samples that are denser below.
_LINES = np.array([-0.5, 0.0, 0.5])
_SAMPLES = 48
# The search starts this much of the length below the region, whose ends are not those of the mask.
_MARGIN = 0.005
_SHARE = np.linspace(0.0, 1.0, _SAMPLES) ** 2 * (1 + _MARGIN) - _MARGIN


def lowest_seen_px(frame: DepthFrame, regions: SearchRegions) -> Float:
    """(T, 2) lowest points of T masks on the centre lines of their regions; NaN where none is.

    The median of three lines, so that single pixels of a mask do not move it.
    """
    low, high = regions.span_px[:, :1], regions.span_px[:, 1:]
    position = low + (high - low) * _SHARE
    line = regions.origin_px[:, None] + position[..., None] * regions.along[:, None]
    aside = (_LINES * regions.half_px[:, None])[..., None] * regions.across[:, None]
    inside = frame.mask_probability(line[:, None] + aside[:, :, None]) >= MASK_THRESHOLD
    lowest = np.take_along_axis(position, inside.argmax(2), 1)
    lowest = np.sort(np.where(inside.any(2), lowest, np.inf), axis=1)[:, len(_LINES) // 2, None]
    lowest = np.where(np.isfinite(lowest), lowest, np.nan)
    return np.asarray(regions.origin_px + lowest * regions.along)


def lowest_std_px(frame: DepthFrame) -> Float:
    """(T,) standard deviations of the lower ends of T masks, in pixels."""
    rows = [mask.cell_height_px for mask in frame.masks or ()]
    spread = 0.0 if frame.masks_given else frame.settings.mask_spread
    return np.asarray(np.hypot(frame.mask_std_px, spread * np.array(rows)))
