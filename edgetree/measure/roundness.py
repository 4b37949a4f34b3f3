"""Tell a single round stem from several stems in one mask by the depth across it."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Bool, Float
from basetree.normal import MAD_TO_STD
from edgetree.measure.constants.depth import (
    ROUNDNESS_WITHIN,
    SEVERAL_STEMS_SCORE,
    SEVERAL_STEMS_STDS,
)
from edgetree.measure.edge_lines import masked_medians
from edgetree.measure.stem_fit import Readings, Stems

# Fewer readings at a station do not show its shape.
_MIN_READINGS = 5
# Readings further from the fitted stem than this many radii are clipped to it or left out.
_MAX_OFF = 2.0
# Least squared difference of the two shapes over the readings of a station.
_MIN_POWER = 0.05
# Share of the stations along the stem that must have enough readings.
_MIN_STATIONS = 0.25


def shows_several_stems(stems: Stems, readings: Readings, stations: int) -> Bool:
    """Whether the depth across the masks is that of two stems side by side, and not of one.

    The depth of each station is compared with both shapes: one circle, and two circles of half its
    radius that touch. Its score is the share of their difference that the readings show, by least
    squares. The score of a mask is the median of its stations.

    Readings far from the stem are clipped to it: between two stems, the background shows along the
    whole mask and so tells them apart. Where most readings are of the background, only the others
    show the shape, so the masks are scored without those, too.

    Args:
        stems: T fitted stems.
        readings: Their depth readings (T, N), station by station.
        stations: Number of stations.

    Returns:
        (T,) flags.
    """
    sections = stems.sections
    view = sections.view(readings.rays)
    shape = (len(readings.depth_m), stations, -1)
    offset = np.abs(view.offset).reshape(shape)
    used = ((view.depth_ratio > 0) & (readings.depth_m > 0)).reshape(shape)
    used &= offset < ROUNDNESS_WITHIN
    # The distance to the axis that each reading gives by itself is the same across a round stem.
    axis_m = (readings.depth_m / np.where(view.depth_ratio > 0, view.depth_ratio, 1.0)).reshape(
        shape
    )
    middle_m, reach_m = stems.distance_m[:, None, None], _MAX_OFF * stems.radius_m[:, None, None]
    near_m = np.clip(axis_m, middle_m - reach_m, middle_m + reach_m)
    used = np.stack([used, used & (near_m == axis_m)])
    per_error = readings.readings_per_error
    return np.asarray(_shows_several(offset, near_m, used, sections.half_rad, per_error).any(0))


def _shows_several(
    offset: Float, axis_m: Float, used: Bool, half_rad: Float, readings_per_error: Float
) -> Bool:
    """(K, T) flags for K choices of readings.

    Args:
        offset: (T, S, N) places across the stems, in half widths from the middle.
        axis_m: (T, S, N) distances to the axis that the readings give.
        used: (K, T, S, N) which of them are used.
        half_rad: (T,) half the viewing angle of the stems.
        readings_per_error: (T,) number of readings that share one error.
    """
    scores, known = _scores(offset, axis_m, used, half_rad)
    score = masked_medians(scores, known)
    scatter = MAD_TO_STD * masked_medians(np.abs(scores - score[..., None]), known)
    seen = known.sum(-1)
    std = scatter / np.sqrt(np.maximum(seen / np.maximum(readings_per_error, 1.0), 1.0))
    enough = seen >= _MIN_STATIONS * known.shape[-1]
    return np.asarray(enough & (score > np.maximum(SEVERAL_STEMS_SCORE, SEVERAL_STEMS_STDS * std)))


def _scores(offset: Float, axis_m: Float, used: Bool, half_rad: Float) -> tuple[Float, Bool]:
    """(K, T, S) scores of the stations, and which are known; arguments as above."""
    mean_m = _means(axis_m, used)
    radius_m = mean_m * np.sin(half_rad)[:, None, None]
    behind = (axis_m - mean_m) / np.where(radius_m > 0, radius_m, 1.0)
    inner = np.clip(np.abs(offset - 0.5) / 0.5, 0.0, 1.0)
    shapes = np.sqrt(1 - np.minimum(offset, 1.0) ** 2) - 0.5 * np.sqrt(1 - inner**2)
    template = np.where(used, shapes - _means(shapes, used), 0.0)
    power = (template**2).sum(-1)
    known = (used.sum(-1) >= _MIN_READINGS) & (power > _MIN_POWER)
    score = (template * np.where(used, behind, 0.0)).sum(-1) / np.where(known, power, 1.0)
    return np.where(known, score, 0.0), known


def _means(values: Float, used: Bool) -> Float:
    """(K, T, S, 1) means of the used ones of (T, S, N) values."""
    total = np.where(used, values, 0.0).sum(-1, keepdims=True)
    return np.asarray(total / np.maximum(used.sum(-1, keepdims=True), 1))
