"""The outline of stems in the picture: where to look, and where their masks have edges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.frame import DepthFrame, MaskGrid

__all__ = [
    "STATIONS",
    "Outline",
    "Strips",
    "find_outline",
    "medians",
    "spans",
    "start_from_masks",
    "weighted_lines",
]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

STATIONS = 24
"""Places along every stem at which it is looked at."""

_SHOWN = 0.5
# Edges are sought across so many half widths, first coarsely, then closely around what was found.
_REACH = 1.8
_COARSE, _FINE = 25, 13
_CLOSE, _LEAST_CLOSE_PX = 0.12, 1.5
_LEAST_STATIONS = 6
# Edges this near to a line (of the half width, or px) agree with it; one that lies beyond counts
# this much against it. Lines are drawn between these quantiles of what both halves show.
_AGREEING, _AGREEING_PX = 0.08, 1.0
_BEYOND = 0.5
_INWARDS = 4.0
_TURNS = 2
_STUBBY = 2.2
_LEAST_AGREEING = 0.1
_QUANTILES = np.array((0.1, 0.4, 0.7, 0.9))
_QUARTER = STATIONS // 4
_HALVES = (slice(0, 2 * _QUARTER), slice(2 * _QUARTER, STATIONS))
_ROUNDS = 3
_LEAST_HALF_PX = 0.5


@dataclass(frozen=True, eq=False)
class Strips:
    """Straight strips of the picture that hold the stems.

    Attributes:
        origin_px: (T, 2) a point on the middle line.
        along: (T, 2) unit vector up the stem.
        half_px: (T,) half the width.
        span_px: (T, 2) lowest and highest place along it, from the origin.
    """

    origin_px: Float
    along: Float
    half_px: Float
    span_px: Float

    @property
    def across(self) -> Float:
        """(T, 2) unit vector to the right of the stem."""
        return np.stack([-self.along[:, 1], self.along[:, 0]], -1)

    @property
    def parts(self) -> tuple[Float, Float, Float, Float]:
        """Its arrays."""
        return self.origin_px, self.along, self.half_px, self.span_px

    @property
    def stations_px(self) -> Float:
        """(T, S) places along the middle line, evenly spread, from low to high."""
        share = (np.arange(STATIONS) + 0.5) / STATIONS
        low, high = self.span_px[:, :1], self.span_px[:, 1:]
        return np.asarray(low + (high - low) * share)

    def points(self, across_px: Float) -> Float:
        """(T, S, C, 2) picture points at the stations, `across_px` (T, S, C) from the middle."""
        line = self.origin_px[:, None] + self.stations_px[..., None] * self.along[:, None]
        points = np.empty((*across_px.shape, 2))
        for axis in (0, 1):
            np.multiply(across_px, self.across[:, axis, None, None], out=points[..., axis])
            points[..., axis] += line[..., axis, None]
        return points


@dataclass(frozen=True, eq=False)
class Outline:
    """What the masks show of the stems at their stations.

    Attributes:
        strips: where was looked.
        left_px, right_px: (T, S) places of the edges across the strip.
        left_valid, right_valid: (T, S) where these are edges of the stem.
        shown: (T,) share of the stations that show some of the stem.
    """

    strips: Strips
    left_px: Float
    right_px: Float
    left_valid: Flags
    right_valid: Flags
    shown: Float


def _moments(mask: MaskGrid) -> tuple[Float, Float, Float, np.bool_]:
    """Origin (2,), direction up (2,) and half width of a strip, and whether it is hardly longer
    than wide.
    """
    weight = np.where(mask.grid >= _SHOWN, mask.grid, 0.0)
    total = float(weight.sum())
    if total == 0:
        return mask.box_px[:2], np.array([0.0, -1.0]), np.array(_LEAST_HALF_PX), np.False_
    cell = (mask.box_px[2:] - mask.box_px[:2]) / mask.grid.shape[::-1]
    x = mask.box_px[0] + (np.arange(mask.grid.shape[1]) + 0.5) * cell[0]
    y = mask.box_px[1] + (np.arange(mask.grid.shape[0]) + 0.5) * cell[1]
    columns, rows = weight.sum(0), weight.sum(1)
    mean_x, mean_y = float(columns @ x) / total, float(rows @ y) / total
    mixed = float((y - mean_y) @ weight @ (x - mean_x)) / total
    spread = np.array(
        [
            [float(columns @ (x - mean_x) ** 2) / total, mixed],
            [mixed, float(rows @ (y - mean_y) ** 2) / total],
        ]
    )
    squares, axes = np.linalg.eigh(spread)
    along = axes[:, 1] * (-1.0 if axes[1, 1] > 0 else 1.0)
    half = total * cell[0] * cell[1] / np.sqrt(12 * max(squares[1], 1e-9)) / 2
    stubby = np.bool_(squares[1] < _STUBBY**2 * squares[0])
    return np.array([mean_x, mean_y]), along, np.asarray(max(half, _LEAST_HALF_PX)), stubby


def spans(origin_px: Float, along: Float, boxes_px: Float) -> Float:
    """(T, 2) where lines through (T, 2) origins leave their boxes (T, 4), downwards and upwards."""
    safe = np.where(np.abs(along) < 1e-6, 1e-6, along)
    ends = (boxes_px.reshape(-1, 2, 2) - origin_px[:, None]) / safe[:, None]
    low, high = np.sort(ends, axis=1).transpose(1, 0, 2)
    return np.stack([low.max(1), high.min(1)], -1)


def start_from_masks(frame: DepthFrame, boxes_px: Float) -> Strips:
    """Strips of stems of which only masks (T,) and boxes (T, 4) are known, by their moments.

    Where the picture leaves little of a near stem, the moments of its mask may lie askew: then
    the picture's upright is tried too, and what the edges of the mask are straighter along taken.
    """
    masks = frame.masks or []
    origin, along, half, stubby = (
        np.stack(part) for part in zip(*map(_moments, masks), strict=True)
    )
    strips = Strips(origin, along, half, spans(origin, along, boxes_px))
    for place in np.flatnonzero(stubby):
        one = replace(frame, masks=[masks[place]])
        at, box = origin[place, None], boxes_px[place, None]
        upright = np.array([[0.0, -1.0]])
        starts = [
            _settled(one, Strips(at, start, half[place, None], spans(at, start, box)))
            for start in (along[place, None], upright)
        ]
        best, _ = max(starts, key=lambda pair: pair[1])
        for mine, its in zip(strips.parts, best.parts, strict=True):
            mine[place] = its[0]
    return strips


def _settled(frame: DepthFrame, strips: Strips) -> tuple[Strips, int]:
    """A strip turned to what its mask shows, and how many edges lie on straight lines then."""
    for _ in range(_TURNS):
        left, right, seen = _coarse_edges(frame, strips)
        agreeing = int(outer_lines(strips, left, right, np.stack([seen] * 2)).agreeing.sum())
        strips = _turned(strips, left, right, seen)
    return strips, agreeing


def find_outline(frame: DepthFrame, strips: Strips, border_px: Float) -> Outline:
    """Look for both edges at every station: coarsely, turning the strips to what the masks show,
    and then closely. Edges within `border_px` (T,) of the picture's border are none: there the
    mask ends, and the stem does not.
    """
    strips = _turned(strips, *_coarse_edges(frame, strips))
    left, right, seen = _coarse_edges(frame, strips)
    left, right, close = _close_edges(frame, strips, left, right, border_px)
    sides = outer_lines(strips, left, right, seen & close)
    agreeing_left, agreeing_right = sides.agreeing
    return Outline(strips, left, right, agreeing_left, agreeing_right, seen.mean(1))


def _coarse_edges(frame: DepthFrame, strips: Strips) -> tuple[Float, Float, Flags]:
    """(T, S) left and right edges across the strips, and where there are both."""
    across = np.linspace(-_REACH, _REACH, _COARSE) * strips.half_px[:, None, None]
    across = np.broadcast_to(across, (len(strips.half_px), STATIONS, _COARSE))
    shown = frame.shown(strips.points(across))
    left, left_seen = _first_crossing(shown, across)
    right, right_seen = _first_crossing(shown[..., ::-1], across[..., ::-1])
    return left, right, left_seen & right_seen


def _close_edges(
    frame: DepthFrame, strips: Strips, left: Float, right: Float, border_px: Float
) -> tuple[Float, Float, Flags]:
    """The same edges (T, S) sought in small steps around where they were found, and (2, T, S)
    where they are.
    """
    width = np.maximum(_CLOSE * strips.half_px, _LEAST_CLOSE_PX)[:, None, None]
    steps = np.linspace(-1.0, 1.0, _FINE) * width
    across = np.stack([left[..., None] + steps, right[..., None] - steps], 2)
    shown = frame.shown(strips.points(across.reshape(*left.shape, -1)))
    found, seen = _first_crossing(shown.reshape(across.shape), across)
    seen = seen & frame.inside(strips.points(found), border_px[:, None, None])
    return found[..., 0], found[..., 1], seen.transpose(2, 0, 1)


def _first_crossing(shown: Float, across: Float) -> tuple[Float, Flags]:
    """(...) where the first of (..., C) samples shows the stem, between it and the one before."""
    inside = shown >= _SHOWN
    first = np.maximum(inside.argmax(-1), 1)[..., None]
    high, low = (np.take_along_axis(shown, at, -1)[..., 0] for at in (first, first - 1))
    end, start = (np.take_along_axis(across, at, -1)[..., 0] for at in (first, first - 1))
    rise = np.where(high > low, high - low, 1.0)
    return start + (end - start) * (_SHOWN - low) / rise, inside.any(-1) & ~inside[..., 0]


def _turned(strips: Strips, left: Float, right: Float, seen: Flags) -> Strips:
    """The strips laid between the lines along both edges."""
    enough = seen.sum(1) >= _LEAST_STATIONS
    sides = outer_lines(strips, left, right, np.stack([seen, seen]))
    value = np.where(enough, (sides.value[1] - sides.value[0]) / 2, 0.0)[:, None]
    slope = np.where(enough, (sides.slope[1] - sides.slope[0]) / 2, 0.0)[:, None]
    along = strips.along + slope * strips.across
    half = np.maximum(sides.value.mean(0), _LEAST_HALF_PX)
    return Strips(
        strips.origin_px + value * strips.across,
        along / np.linalg.norm(along, axis=1, keepdims=True),
        np.where(enough, half, strips.half_px),
        strips.span_px,
    )


class OuterLines(NamedTuple):
    """Straight edges of T stems on both sides, left first, as distances outwards.

    `value` (2, T) at place 0 and `slope` (2, T); `agreeing` (2, T, S) the stations on them.
    """

    value: Float
    slope: Float
    agreeing: Flags


def outer_lines(strips: Strips, left: Float, right: Float, seen: Flags) -> OuterLines:
    """The straight edges of the stems.

    What hides a stem can only make its mask narrower. So of many lines the one is taken that the
    most stations agree with and that the fewest lie beyond, and then fitted to those that agree.

    Args:
        strips: where was looked.
        left, right: (T, S) edges of the masks across the strips.
        seen: (2, T, S) where there are some.
    """
    count = len(left)
    place = np.concatenate([strips.stations_px] * 2)
    outward, seen = np.concatenate([-left, right]), seen.reshape(2 * count, -1)
    tolerance = np.maximum(_AGREEING * strips.half_px, _AGREEING_PX)
    tolerance = np.concatenate([tolerance] * 2)[:, None]
    value, slope = _best_line(place, outward, seen, tolerance)
    for _ in range(_ROUNDS):
        miss = (outward - value[:, None] - slope[:, None] * place) / tolerance
        weight = np.where(seen, np.maximum(1 - (miss / 2) ** 2, 0) ** 2, 0.0)
        value, slope = weighted_lines(place, np.where(seen, outward, 0.0), weight)
    miss = outward - value[:, None] - slope[:, None] * place
    agree = seen & (np.abs(miss) < tolerance)
    # A butt swells outwards; inwards lie what hides the stem and the round of its foot.
    scatter = medians(np.abs(miss), agree)[:, None]
    agree &= miss > -np.maximum(_INWARDS * scatter, _AGREEING_PX)
    agree &= agree.mean(1, keepdims=True) >= _LEAST_AGREEING
    return OuterLines(value.reshape(2, -1), slope.reshape(2, -1), agree.reshape(2, count, -1))


def _best_line(place: Float, outward: Float, seen: Flags, tolerance: Float) -> tuple[Float, Float]:
    """Of some lines for each edge the one that the most stations agree with."""
    rows = np.arange(len(place))
    sets = [_across_halves(place, outward, seen)]
    sets += [_within_half(place, outward, seen, half) for half in _HALVES]
    value, slope = (np.concatenate(parts, 1) for parts in zip(*sets, strict=True))
    miss = outward[:, None] - value[..., None] - slope[..., None] * place[:, None]
    miss = miss / tolerance[:, None]
    near = np.maximum(1 - miss**2, 0.0) - _BEYOND * (miss > 1)
    best = np.where(seen[:, None], near, 0.0).sum(2).argmax(1)
    return value[rows, best], slope[rows, best]


def _across_halves(place: Float, outward: Float, seen: Flags) -> tuple[Float, Float]:
    """Values and slopes (T, K) of lines from quantiles of the lower half of the stations to those
    of the upper half; level ones where only one half shows an edge.
    """
    ends = []
    for half in _HALVES:
        ordered = np.sort(np.where(seen[:, half], outward[:, half], np.inf), axis=1)
        rank = (_QUANTILES * np.maximum(seen[:, half].sum(1) - 1, 0)[:, None]).astype(np.intp)
        value = np.take_along_axis(ordered, rank, 1)
        ends.append(np.where(np.isfinite(value), value, np.nan))
    low_place, high_place = (place[:, half].mean(1)[:, None] for half in _HALVES)
    low, high = ends
    only_low, only_high = (np.isnan(part).all(axis=1, keepdims=True) for part in (high, low))
    high = np.where(only_low, low, high)
    low = np.where(only_high, high, low)
    low, high = (np.nan_to_num(part) for part in (low, high))
    slope = (high[:, None, :] - low[:, :, None]) / (high_place - low_place)[..., None]
    slope = slope.reshape(len(place), -1)
    return np.repeat(low, len(_QUANTILES), 1) - slope * low_place, slope


def _within_half(place: Float, outward: Float, seen: Flags, half: slice) -> tuple[Float, Float]:
    """Value and slope (T, 1) of the line through the medians of both quarters of one half: of a
    leaning stem whose other half is hidden.
    """
    quarters = (slice(half.start, half.start + _QUARTER), slice(half.start + _QUARTER, half.stop))
    near, far = (place[:, part].mean(1) for part in quarters)
    low, high = (medians(outward[:, part], seen[:, part]) for part in quarters)
    slope = (high - low) / (far - near)
    return (low - slope * near)[:, None], slope[:, None]


def medians(values: Float, valid: Flags) -> Float:
    """(T,) medians of the valid ones among (T, N) values, 0 where there are none."""
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    middle = np.minimum(valid.sum(1) // 2, values.shape[1] - 1)
    found = ordered[np.arange(len(values)), middle]
    return np.where(np.isfinite(found), found, 0.0)


def weighted_lines(place: Float, value: Float, weight: Float) -> tuple[Float, Float]:
    """(T,) values at place 0 and slopes of the lines of least squares through (T, S) values."""
    total = np.maximum(weight.sum(1), 1e-12)
    mean_place, mean_value = (weight * place).sum(1) / total, (weight * value).sum(1) / total
    offset = place - mean_place[:, None]
    square = (weight * offset**2).sum(1)
    slope = (weight * offset * value).sum(1) / np.where(square > 1e-12, square, np.inf)
    return mean_value - slope * mean_place, slope
