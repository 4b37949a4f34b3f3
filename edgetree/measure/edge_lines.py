"""Robust straight lines along the edges of stems."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Bool, Float, Index
from edgetree.measure.constants.outlines import EDGE_TOLERANCE, MIN_EDGE_TOLERANCE_PX
from edgetree.measure.regions import OUTWARDS, SearchRegions

# Votes on candidate lines: an edge on a line counts up to 1. One outside it counts against it, and
# twice as much as a vote does one inside it at which the depth shows that the stem ends there.
_OUTSIDE_PENALTY, _CERTAIN_PENALTY = 0.5, 2.0
# Edges further inside a line than this many times the median distance are removed.
_MAX_INSIDE = 4.0
# Smallest share of the stations that must agree with a line.
_MIN_AGREEING = 0.1
# Candidate lines join these quantiles of the edges in both halves of the stem.
_QUANTILES = np.array((0.1, 0.4, 0.7, 0.9))
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
    agreeing: Bool


def outer_lines(
    regions: SearchRegions, edges_px: Float, seen: Bool, certain: Bool | None = None
) -> OuterLines:
    """Robustly fit a straight line to each edge of the stems.

    An object in front of a stem can only make its mask narrower, so edges inside the line are
    outliers and edges outside it count against the line. Where the depth shows that the stem ends
    at its edge, a line outside this edge is wrong. The best of several candidate lines starts a
    least squares fit with Tukey's biweights.

    Args:
        regions: Search regions.
        edges_px: (2, T, S) left and right edges of the masks across the regions.
        seen: (2, T, S) where an edge was found, or (T, S) where both were.
        certain: (2, T, S) where the depth shows that the stem ends at the edge, if known.
    """
    seen = np.broadcast_to(seen, edges_px.shape)
    position, outward = regions.stations_px, np.where(seen, OUTWARDS * edges_px, 0.0)
    tolerance = np.maximum(EDGE_TOLERANCE * regions.half_px, MIN_EDGE_TOLERANCE_PX)[:, None]
    ends = np.zeros_like(seen) if certain is None else seen & certain
    value, slope = _best_line(position, outward, seen, ends, tolerance)
    for _ in range(_ROUNDS):
        residual = (outward - value[..., None] - slope[..., None] * position) / tolerance
        weight = np.where(seen, np.maximum(1 - (residual / 2) ** 2, 0) ** 2, 0.0)
        value, slope = fit_lines(position, outward, weight)
    residual = outward - value[..., None] - slope[..., None] * position
    agree = seen & (np.abs(residual) < tolerance)
    # The butt of a stem flares outwards. Edges that lie inside the line belong to something in
    # front of the stem, or to its rounded foot.
    scatter = masked_medians(np.abs(residual), agree)[..., None]
    agree &= residual > -np.maximum(_MAX_INSIDE * scatter, MIN_EDGE_TOLERANCE_PX)
    agree &= agree.mean(-1, keepdims=True) >= _MIN_AGREEING
    return OuterLines(value, slope, agree)


def _best_line(
    position: Float, outward: Float, seen: Bool, certain: Bool, tolerance: Float
) -> tuple[Float, Float]:
    """Value and slope (2, T) of the candidate line that the most stations agree with."""
    sets = (
        _lines_across_halves(position, outward, seen),
        _lines_in_halves(position, outward, seen),
    )
    value, slope = (np.concatenate(parts, -1) for parts in zip(*sets, strict=True))
    residual = outward[..., None, :] - value[..., None] - slope[..., None] * position[:, None]
    residual = residual / tolerance[..., None]
    score = np.maximum(1 - residual**2, 0.0) - _OUTSIDE_PENALTY * (residual > 1)
    score -= _CERTAIN_PENALTY * ((residual < -1) & certain[..., None, :])
    best = np.vecdot(score, seen[..., None, :].astype(np.float64)).argmax(-1)
    return pick(value, best), pick(slope, best)


def _lines_across_halves(position: Float, outward: Float, seen: Bool) -> tuple[Float, Float]:
    """Values and slopes (2, T, K) of lines between quantiles of the lower and the upper half.

    Where only one half shows an edge the lines are parallel to the centre line.
    """
    outward, seen = _parts(outward, 2), _parts(seen, 2)
    count = seen.sum(-1)[..., None]
    ordered = np.sort(np.where(seen, outward, np.inf))
    rank = (_QUANTILES * np.maximum(count - 1, 0)).astype(np.intp)
    value = np.take_along_axis(ordered, rank, -1)
    value = np.where(count > 0, value, value[..., ::-1, :])
    value = np.where(np.isfinite(value), value, 0.0)
    low, high = value[..., 0, :], value[..., 1, :]
    middle = _parts(position, 2).mean(-1)
    low_position, high_position = middle[:, :1], middle[:, 1:]
    slope = (high[..., None, :] - low[..., :, None]) / (high_position - low_position)[..., None]
    slope = slope.reshape(*low.shape[:-1], -1)
    return np.repeat(low, len(_QUANTILES), -1) - slope * low_position, slope


def _lines_in_halves(position: Float, outward: Float, seen: Bool) -> tuple[Float, Float]:
    """Values and slopes (2, T, 2) of the lines through the medians of both quarters of each half.

    For leaning stems whose other half is hidden.
    """
    middle = _parts(position, 4).mean(-1)
    value = masked_medians(_parts(outward, 4), _parts(seen, 4))
    slope = (value[..., 1::2] - value[..., ::2]) / (middle[:, 1::2] - middle[:, ::2])
    return value[..., ::2] - slope * middle[:, ::2], slope


def _parts(values: NDArray[Any], count: int) -> NDArray[Any]:
    """(..., count, S / count) values (..., S) in parts of the stem, from low to high."""
    return values.reshape(*values.shape[:-1], count, -1)


def pick(values: NDArray[Any], index: Index) -> NDArray[Any]:
    """Pick one of N values in each row.

    Args:
        values: (A, N) rows, where A may be several axes.
        index: (..., A) which value of each row; leading axes pick from the same rows.

    Returns:
        (..., A) the values.
    """
    first = np.arange(0, values.size, values.shape[-1]).reshape(values.shape[:-1])
    return np.asarray(values.take(first + index))


def masked_medians(values: Float, valid: Bool) -> Float:
    """(...) medians of the valid ones among (..., N) values; 0 where none is valid."""
    ordered = np.where(valid, values, np.inf)
    ordered.sort(-1)
    count = values.shape[-1]
    # Sums of flags take much longer over short axes.
    number = np.matmul(valid, np.ones(count, np.float32)).astype(np.intp)
    middle = np.minimum(number // 2, count - 1)
    found = ordered.take(middle + np.arange(0, ordered.size, count).reshape(middle.shape))
    return np.where(np.isfinite(found), found, 0.0)


def median(values: Float) -> float:
    """The median of (N,) values without NaN, at least one; `np.median` takes much longer."""
    ordered, count = np.sort(values), len(values)
    return float(ordered[(count - 1) // 2] + ordered[count // 2]) / 2


def fit_lines(position: Float, value: Float, weight: Float) -> tuple[Float, Float]:
    """Weighted least squares lines.

    Args:
        position, value, weight: (..., S) points of the lines and their weights.

    Returns:
        (...) values at position 0, and (...) slopes.
    """
    total = np.maximum(weight.sum(-1), 1e-12)
    mean_position = np.vecdot(weight, position) / total
    mean_value = np.vecdot(weight, value) / total
    offset = position - mean_position[..., None]
    weighted = weight * offset
    square = np.vecdot(weighted, offset)
    slope = np.vecdot(weighted, value) / np.where(square > 1e-12, square, np.inf)
    return mean_value - slope * mean_position, slope
