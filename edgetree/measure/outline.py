"""Find the left and right edges of stems in their masks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame, MaskGrid

__all__ = [
    "STATIONS",
    "Outline",
    "SearchRegions",
    "fit_lines",
    "line_spans",
    "masked_medians",
    "regions_from_masks",
    "trace_outline",
]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

STATIONS = 24
"""Number of cross-lines along every stem, at which its edges and depth are sampled."""

# Edges are searched for across this many half widths, with this many samples. A second search
# around each edge found takes more samples over this part of the half width, or at least px.
_SEARCH_HALF_WIDTHS = 1.8
_COARSE_SAMPLES, _FINE_SAMPLES = 25, 13
_FINE_REACH, _MIN_FINE_REACH_PX = 0.12, 1.5
# With fewer stations than this a search region is not realigned.
_MIN_STATIONS = 6
# An edge agrees with a line within this fraction of the half width, or this many px.
_TOLERANCE, _MIN_TOLERANCE_PX = 0.08, 1.0
# Score that a candidate line loses for every edge that lies outside it.
_OUTSIDE_PENALTY = 0.5
# Edges further inside a line than this many times the median distance are removed.
_MAX_INSIDE = 4.0
# Smallest fraction of stations that must agree with a line.
_MIN_AGREEING = 0.1
# Realignments of a region from each start, and the aspect ratio of a mask below which the
# direction from its moments is not trusted alone.
_REALIGNMENTS = 2
_MIN_ASPECT = 2.2
# Candidate lines join these quantiles of the edges in both halves of the stem.
_QUANTILES = np.array((0.1, 0.4, 0.7, 0.9))
_QUARTER = STATIONS // 4
_HALVES = (slice(0, 2 * _QUARTER), slice(2 * _QUARTER, STATIONS))
# Rounds of reweighted least squares.
_ROUNDS = 3
_MIN_HALF_PX = 0.5


@dataclass(frozen=True, eq=False)
class SearchRegions:
    """Straight regions of the image around T stems, in which their edges are searched for.

    Attributes:
        origin_px: (T, 2) a point on the region's centre line.
        along: (T, 2) unit vector of the centre line, up the stem.
        half_px: (T,) half the width.
        span_px: (T, 2) lowest and highest position along the centre line, from the origin.
    """

    origin_px: Float
    along: Float
    half_px: Float
    span_px: Float

    @property
    def across(self) -> Float:
        """(T, 2) unit vector at right angles to the centre line, to the right of the stem."""
        return np.stack([-self.along[:, 1], self.along[:, 0]], -1)

    @property
    def arrays(self) -> tuple[Float, Float, Float, Float]:
        """All arrays, in the order of the attributes."""
        return self.origin_px, self.along, self.half_px, self.span_px

    @property
    def stations_px(self) -> Float:
        """(T, S) evenly spaced positions along the centre line, from low to high."""
        fraction = (np.arange(STATIONS) + 0.5) / STATIONS
        low, high = self.span_px[:, :1], self.span_px[:, 1:]
        return np.asarray(low + (high - low) * fraction)

    def points(self, across_px: Float) -> Float:
        """Image points at the stations.

        Args:
            across_px: (T, S, C) offsets from the centre line, positive to the right.

        Returns:
            (T, S, C, 2) points in pixels.
        """
        line = self.origin_px[:, None] + self.stations_px[..., None] * self.along[:, None]
        points = np.empty((*across_px.shape, 2))
        for axis in (0, 1):
            np.multiply(across_px, self.across[:, axis, None, None], out=points[..., axis])
            points[..., axis] += line[..., axis, None]
        return points


@dataclass(frozen=True, eq=False)
class Outline:
    """The edges of T stems in their masks, at S stations.

    Attributes:
        regions: search regions.
        left_px, right_px: (T, S) positions of the edges across the region.
        left_valid, right_valid: (T, S) whether these are edges of the stem itself.
        visible_fraction: (T,) fraction of the stations at which the mask shows both sides.
    """

    regions: SearchRegions
    left_px: Float
    right_px: Float
    left_valid: Flags
    right_valid: Flags
    visible_fraction: Float


def _mask_moments(mask: MaskGrid) -> tuple[Float, Float, Float, np.bool_]:
    """Centre line of one mask from its image moments.

    The half width is that of a rectangle of the same area, whose variance along its length L is
    L² / 12.

    Returns:
        Origin (2,), direction up the stem (2,), half width, and whether the mask is too short for
        its width to trust the direction.
    """
    weight = np.where(mask.grid >= MASK_THRESHOLD, mask.grid, 0.0)
    total = float(weight.sum())
    if total == 0:
        return mask.box_px[:2], np.array([0.0, -1.0]), np.array(_MIN_HALF_PX), np.False_
    cell = (mask.box_px[2:] - mask.box_px[:2]) / mask.grid.shape[::-1]
    x = mask.box_px[0] + (np.arange(mask.grid.shape[1]) + 0.5) * cell[0]
    y = mask.box_px[1] + (np.arange(mask.grid.shape[0]) + 0.5) * cell[1]
    columns, rows = weight.sum(0), weight.sum(1)
    mean_x, mean_y = float(columns @ x) / total, float(rows @ y) / total
    mixed = float((y - mean_y) @ weight @ (x - mean_x)) / total
    covariance = np.array(
        [
            [float(columns @ (x - mean_x) ** 2) / total, mixed],
            [mixed, float(rows @ (y - mean_y) ** 2) / total],
        ]
    )
    variances, axes = np.linalg.eigh(covariance)
    along = axes[:, 1] * (-1.0 if axes[1, 1] > 0 else 1.0)
    half = total * cell[0] * cell[1] / np.sqrt(12 * max(variances[1], 1e-9)) / 2
    short = np.bool_(variances[1] < _MIN_ASPECT**2 * variances[0])
    return np.array([mean_x, mean_y]), along, np.asarray(max(half, _MIN_HALF_PX)), short


def line_spans(origin_px: Float, along: Float, boxes_px: Float) -> Float:
    """Where lines leave their boxes.

    Args:
        origin_px: (T, 2) points on the lines.
        along: (T, 2) unit vectors of the lines.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.

    Returns:
        (T, 2) positions along each line, from its origin: against its direction and in it.
    """
    safe = np.where(np.abs(along) < 1e-6, 1e-6, along)
    ends = (boxes_px.reshape(-1, 2, 2) - origin_px[:, None]) / safe[:, None]
    low, high = np.sort(ends, axis=1).transpose(1, 0, 2)
    return np.stack([low.max(1), high.min(1)], -1)


def regions_from_masks(frame: DepthFrame, boxes_px: Float) -> SearchRegions:
    """Search regions of stems that have masks but no keypoints at their section.

    The direction comes from the image moments of each mask. If the mask is short for its width,
    as of a near stem that the image cuts off, the moments may point askew. Then the vertical of
    the image is tried as well, and the direction with more edges on straight lines wins.

    Args:
        frame: the frame, with one mask per stem.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.
    """
    masks = frame.masks or []
    origin, along, half, short = (
        np.stack(part) for part in zip(*map(_mask_moments, masks), strict=True)
    )
    regions = SearchRegions(origin, along, half, line_spans(origin, along, boxes_px))
    for index in np.flatnonzero(short):
        single = replace(frame, masks=[masks[index]])
        start, box = origin[index, None], boxes_px[index, None]
        vertical = np.array([[0.0, -1.0]])
        candidates = [
            _repeatedly_realigned(
                single,
                SearchRegions(
                    start, direction, half[index, None], line_spans(start, direction, box)
                ),
            )
            for direction in (along[index, None], vertical)
        ]
        best, _ = max(candidates, key=lambda pair: pair[1])
        for target, source in zip(regions.arrays, best.arrays, strict=True):
            target[index] = source[0]
    return regions


def _repeatedly_realigned(frame: DepthFrame, regions: SearchRegions) -> tuple[SearchRegions, int]:
    """Align a region with its mask's edges; also return how many edges lay on straight lines."""
    for _ in range(_REALIGNMENTS):
        left, right, seen = _coarse_edges(frame, regions)
        agreeing = int(outer_lines(regions, left, right, np.stack([seen] * 2)).agreeing.sum())
        regions = _realigned(regions, left, right, seen)
    return regions, agreeing


def trace_outline(frame: DepthFrame, regions: SearchRegions, border_px: Float) -> Outline:
    """Find both edges of every stem at every station.

    A coarse search first aligns the search regions with the masks, then a fine search locates the
    edges.

    Args:
        frame: the frame, with one mask per stem.
        regions: where to search.
        border_px: (T,) edges closer than this to the border of the image are not valid, since
            there the image ends and not the stem.
    """
    regions = _realigned(regions, *_coarse_edges(frame, regions))
    left, right, seen = _coarse_edges(frame, regions)
    left, right, found = _fine_edges(frame, regions, left, right, border_px)
    left_valid, right_valid = outer_lines(regions, left, right, seen & found).agreeing
    return Outline(regions, left, right, left_valid, right_valid, seen.mean(1))


def _coarse_edges(frame: DepthFrame, regions: SearchRegions) -> tuple[Float, Float, Flags]:
    """(T, S) left and right edges in px across the regions, and where both were found."""
    across = np.linspace(-_SEARCH_HALF_WIDTHS, _SEARCH_HALF_WIDTHS, _COARSE_SAMPLES)
    across = across * regions.half_px[:, None, None]
    across = np.broadcast_to(across, (len(regions.half_px), STATIONS, _COARSE_SAMPLES))
    probability = frame.mask_probability(regions.points(across))
    left, left_seen = _first_crossing(probability, across)
    right, right_seen = _first_crossing(probability[..., ::-1], across[..., ::-1])
    return left, right, left_seen & right_seen


def _fine_edges(
    frame: DepthFrame, regions: SearchRegions, left: Float, right: Float, border_px: Float
) -> tuple[Float, Float, Flags]:
    """Refine (T, S) edges; also return (2, T, S) where a left and a right edge was found."""
    reach = np.maximum(_FINE_REACH * regions.half_px, _MIN_FINE_REACH_PX)[:, None, None]
    steps = np.linspace(-1.0, 1.0, _FINE_SAMPLES) * reach
    across = np.stack([left[..., None] + steps, right[..., None] - steps], 2)
    probability = frame.mask_probability(regions.points(across.reshape(*left.shape, -1)))
    found, seen = _first_crossing(probability.reshape(across.shape), across)
    seen = seen & frame.inside(regions.points(found), border_px[:, None, None])
    return found[..., 0], found[..., 1], seen.transpose(2, 0, 1)


def _first_crossing(probability: Float, across: Float) -> tuple[Float, Flags]:
    """First position at which a mask rises above the threshold, linearly interpolated.

    Args:
        probability: (..., C) samples of the mask.
        across: (..., C) their positions.

    Returns:
        (...) positions, and (...) whether there is such a crossing.
    """
    inside = probability >= MASK_THRESHOLD
    first = np.maximum(inside.argmax(-1), 1)[..., None]
    high, low = (np.take_along_axis(probability, at, -1)[..., 0] for at in (first, first - 1))
    end, start = (np.take_along_axis(across, at, -1)[..., 0] for at in (first, first - 1))
    rise = np.where(high > low, high - low, 1.0)
    crossing = start + (end - start) * (MASK_THRESHOLD - low) / rise
    return crossing, inside.any(-1) & ~inside[..., 0]


def _realigned(regions: SearchRegions, left: Float, right: Float, seen: Flags) -> SearchRegions:
    """Move and turn the regions to lie midway between the lines along both edges."""
    enough = seen.sum(1) >= _MIN_STATIONS
    sides = outer_lines(regions, left, right, np.stack([seen, seen]))
    value = np.where(enough, (sides.value[1] - sides.value[0]) / 2, 0.0)[:, None]
    slope = np.where(enough, (sides.slope[1] - sides.slope[0]) / 2, 0.0)[:, None]
    along = regions.along + slope * regions.across
    half = np.maximum(sides.value.mean(0), _MIN_HALF_PX)
    return SearchRegions(
        regions.origin_px + value * regions.across,
        along / np.linalg.norm(along, axis=1, keepdims=True),
        np.where(enough, half, regions.half_px),
        regions.span_px,
    )


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


def outer_lines(regions: SearchRegions, left: Float, right: Float, seen: Flags) -> OuterLines:
    """Robustly fit a straight line to each edge of the stems.

    An object in front of a stem can only make its mask narrower, so edges inside the line are
    outliers and edges outside it count against the line. The best of several candidate lines
    starts a least squares fit with Tukey's biweights.

    Args:
        regions: search regions.
        left, right: (T, S) edges of the masks across the regions, in px.
        seen: (2, T, S) where a left and a right edge was found.
    """
    count = len(left)
    position = np.concatenate([regions.stations_px] * 2)
    outward, seen = np.concatenate([-left, right]), seen.reshape(2 * count, -1)
    tolerance = np.maximum(_TOLERANCE * regions.half_px, _MIN_TOLERANCE_PX)
    tolerance = np.concatenate([tolerance] * 2)[:, None]
    value, slope = _best_line(position, outward, seen, tolerance)
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
    position: Float, outward: Float, seen: Flags, tolerance: Float
) -> tuple[Float, Float]:
    """Value and slope (T,) of the candidate line that the most stations agree with."""
    rows = np.arange(len(position))
    sets = [_lines_across_halves(position, outward, seen)]
    sets += [_line_within_half(position, outward, seen, half) for half in _HALVES]
    value, slope = (np.concatenate(parts, 1) for parts in zip(*sets, strict=True))
    residual = outward[:, None] - value[..., None] - slope[..., None] * position[:, None]
    residual = residual / tolerance[:, None]
    score = np.maximum(1 - residual**2, 0.0) - _OUTSIDE_PENALTY * (residual > 1)
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
