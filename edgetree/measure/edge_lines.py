"""Robust straight lines along the edges of stems."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.regions import STATIONS, SearchRegions

__all__ = ["OuterLines", "fit_lines", "masked_medians", "outer_lines"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

# An edge agrees with a line within this fraction of the half width, or this many px.
_TOLERANCE, _MIN_TOLERANCE_PX = 0.08, 1.0
# Score that a candidate line loses for every edge that lies outside it.
_OUTSIDE_PENALTY = 0.5
# The same for every edge inside it at which the depth shows that the stem ends there.
_CERTAIN_PENALTY = 2.0
# Edges further inside a line than this many times the median distance are removed.
_MAX_INSIDE = 4.0
# Smallest fraction of stations that must agree with a line.
_MIN_AGREEING = 0.1
# Candidate lines join these quantiles of the edges in both halves of the stem.
_QUANTILES = np.array((0.1, 0.4, 0.7, 0.9))
_QUARTER = STATIONS // 4
_HALVES = (slice(0, 2 * _QUARTER), slice(2 * _QUARTER, STATIONS))
# Rounds of reweighted least squares.
_ROUNDS = 3


class OuterLines(NamedTuple):
    """Straight lines along the left and right edges of T stems.

    Attributes:
        value: (2, T) distance outwards from the centre line at position 0, in px.
        slope: (2, T) its change per px along the stem.
        agreeing: (2, T, S) stations whose edge lies on the line.
    """

    value: Float
    slope: Float
    agreeing: Flags


def outer_lines(
    regions: SearchRegions, left: Float, right: Float, seen: Flags, certain: Flags | None = None
) -> OuterLines:
    """Robustly fit a straight line to each edge of the stems.

    An object in front of a stem can only make its mask narrower, so edges inside the line are
    outliers and edges outside it count against the line. Where the depth shows that the stem ends
    at its edge, a line outside this edge is wrong. The best of several candidate lines starts a
    least squares fit with Tukey's biweights.

    Args:
        regions: search regions.
        left, right: (T, S) edges of the masks across the regions, in px.
        seen: (2, T, S) where a left and a right edge was found.
        certain: (2, T, S) where the depth shows that the stem ends at the edge, if known.
    """
    count = len(left)
    position = np.concatenate([regions.stations_px] * 2)
    outward, seen = np.concatenate([-left, right]), seen.reshape(2 * count, -1)
    tolerance = np.maximum(_TOLERANCE * regions.half_px, _MIN_TOLERANCE_PX)
    tolerance = np.concatenate([tolerance] * 2)[:, None]
    ends = np.zeros_like(seen) if certain is None else seen & certain.reshape(2 * count, -1)
    value, slope = _best_line(position, outward, seen, ends, tolerance)
    for _ in range(_ROUNDS):
        residual = (outward - value[:, None] - slope[:, None] * position) / tolerance
        weight = np.where(seen, np.maximum(1 - (residual / 2) ** 2, 0) ** 2, 0.0)
        value, slope = fit_lines(position, np.where(seen, outward, 0.0), weight)
    residual = outward - value[:, None] - slope[:, None] * position
    agree = seen & (np.abs(residual) < tolerance)
    # The butt of a stem flares outwards. Edges that lie inside the line belong to something in
    # front of the stem, or to its rounded foot.
    scatter = masked_medians(np.abs(residual), agree)[:, None]
    agree &= residual > -np.maximum(_MAX_INSIDE * scatter, _MIN_TOLERANCE_PX)
    agree &= agree.mean(1, keepdims=True) >= _MIN_AGREEING
    return OuterLines(value.reshape(2, -1), slope.reshape(2, -1), agree.reshape(2, count, -1))


def _best_line(
    position: Float, outward: Float, seen: Flags, certain: Flags, tolerance: Float
) -> tuple[Float, Float]:
    """Value and slope (T,) of the candidate line that the most stations agree with."""
    rows = np.arange(len(position))
    sets = [_lines_across_halves(position, outward, seen)]
    sets += [_line_within_half(position, outward, seen, half) for half in _HALVES]
    value, slope = (np.concatenate(parts, 1) for parts in zip(*sets, strict=True))
    residual = outward[:, None] - value[..., None] - slope[..., None] * position[:, None]
    residual = residual / tolerance[:, None]
    score = np.maximum(1 - residual**2, 0.0) - _OUTSIDE_PENALTY * (residual > 1)
    score -= _CERTAIN_PENALTY * ((residual < -1) & certain[:, None])
    best = np.where(seen[:, None], score, 0.0).sum(2).argmax(1)
    return value[rows, best], slope[rows, best]


def _lines_across_halves(position: Float, outward: Float, seen: Flags) -> tuple[Float, Float]:
    """Values and slopes (T, K) of lines between quantiles of the lower and the upper half.

    Where only one half shows an edge the lines are parallel to the centre line.
    """
    ends = []
    for half in _HALVES:
        ordered = np.sort(np.where(seen[:, half], outward[:, half], np.inf), axis=1)
        rank = (_QUANTILES * np.maximum(seen[:, half].sum(1) - 1, 0)[:, None]).astype(np.intp)
        value = np.take_along_axis(ordered, rank, 1)
        ends.append(np.where(np.isfinite(value), value, np.nan))
    low_position, high_position = (position[:, half].mean(1)[:, None] for half in _HALVES)
    low, high = ends
    only_low, only_high = (np.isnan(part).all(axis=1, keepdims=True) for part in (high, low))
    high = np.where(only_low, low, high)
    low = np.where(only_high, high, low)
    low, high = (np.nan_to_num(part) for part in (low, high))
    slope = (high[:, None, :] - low[:, :, None]) / (high_position - low_position)[..., None]
    slope = slope.reshape(len(position), -1)
    return np.repeat(low, len(_QUANTILES), 1) - slope * low_position, slope


def _line_within_half(
    position: Float, outward: Float, seen: Flags, half: slice
) -> tuple[Float, Float]:
    """Value and slope (T, 1) of the line through the medians of both quarters of one half.

    For leaning stems whose other half is hidden.
    """
    quarters = (slice(half.start, half.start + _QUARTER), slice(half.start + _QUARTER, half.stop))
    near, far = (position[:, part].mean(1) for part in quarters)
    low, high = (masked_medians(outward[:, part], seen[:, part]) for part in quarters)
    slope = (high - low) / (far - near)
    return (low - slope * near)[:, None], slope[:, None]


def masked_medians(values: Float, valid: Flags) -> Float:
    """(T,) medians of the valid ones among (T, N) values; 0 where none is valid."""
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    middle = np.minimum(valid.sum(1) // 2, values.shape[1] - 1)
    found = ordered[np.arange(len(values)), middle]
    return np.where(np.isfinite(found), found, 0.0)


def fit_lines(position: Float, value: Float, weight: Float) -> tuple[Float, Float]:
    """Weighted least squares lines.

    Args:
        position, value, weight: (T, S) points of T lines and their weights.

    Returns:
        (T,) values at position 0, and (T,) slopes.
    """
    total = np.maximum(weight.sum(1), 1e-12)
    mean_position = (weight * position).sum(1) / total
    mean_value = (weight * value).sum(1) / total
    offset = position - mean_position[:, None]
    square = (weight * offset**2).sum(1)
    slope = (weight * offset * value).sum(1) / np.where(square > 1e-12, square, np.inf)
    return mean_value - slope * mean_position, slope
