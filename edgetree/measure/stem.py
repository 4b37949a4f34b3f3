"""Where stems stand and how round they are: distance, tilt and width of their axes from depth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.outline import medians
from edgetree.measure.section import AxisFrames, Sections
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.width import HalfAngle, StemEdges, fuse

__all__ = ["USED_WIDTH", "Readings", "Stems", "fit_stems"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

USED_WIDTH = 0.8
"""Readings nearer to an edge than this share of the half width may be of the background."""

_LEAST_READINGS = 4
# Stems bend and taper: a straight one of constant radius is off by this share of the squared
# length (1/m), so that what is seen close to the section counts most.
_BEND_PER_M = 0.02
# The first line is sought among tilts up to so many standard deviations and these levels of the
# sorted readings, by the support among every so manieth reading.
_STEEPEST = 6.0
_SLOPES = 15
_LEVELS = np.array((0.15, 0.3, 0.5, 0.7, 0.85))
_JUDGED = 4
_TURNS = 5
_SETTLED_RAD = 3e-3
_ROUNDS = (3, 2)
_CUTOFF = 4.0
# Readings that disagree may be the stem, and those that agree what hides it: the distance is
# doubted by this much of itself, times the square of their share.
_DOUBT = 0.5
# The assumed noise counts as much as this many independent readings.
_NOISE_PRIOR = 8.0


class Readings(NamedTuple):
    """Depth on T stems: `rays` (T, N, 3) with z = 1, `depth_m` (T, N), 0 where there is none, and
    `per_error` (T,), how many neighbours share one error of the sensor.
    """

    rays: Float
    depth_m: Float
    per_error: Float


@dataclass(frozen=True, eq=False)
class Stems:
    """T stems near their sections.

    Attributes:
        sections: edges and axes.
        distance_m: (T,) from the camera to the axis at the section, across the axis.
        distance_std_m: (T,) its standard deviation.
        tilt_std_rad: (T,) standard deviation of the axis' angle towards or away from the camera.
        half_std_rad: (T,) of the half angle.
        growth: (T,) how much the distance grows, as a share of it, per radian of half angle.
        sources: half angles by keypoints, masks and the roundness of the depth, each by itself.
        shares: (T, 3) what each source counted in the half angle.
        arc_rad: (T,) how much of the round the readings cover.
        used: (T,) number of readings that agree; too few where the stem could not be fitted.
        agreeing: (T,) their share.
    """

    sections: Sections
    distance_m: Float
    distance_std_m: Float
    tilt_std_rad: Float
    half_std_rad: Float
    growth: Float
    sources: list[HalfAngle]
    shares: Float
    arc_rad: Float
    used: NDArray[np.intp]
    agreeing: Float

    @cached_property
    def fitted(self) -> Flags:
        """(T,) whether the depth says where the stem stands."""
        sound = np.isfinite(self.distance_m) & (self.distance_m > 0)
        return np.asarray(sound & (self.used >= _LEAST_READINGS) & (self.sections.centre[:, 2] > 0))

    @cached_property
    def radius_m(self) -> Float:
        """(T,) radius at the section."""
        return np.asarray(self.distance_m * np.sin(self.sections.half_rad))


@dataclass(eq=False)
class _Lines:
    """1 / distance = value + slope * (height - the section's) + g * (half angle - the assumed).

    `information` (T, 3, 3) and `right` (T, 3) are the normal equations of value, slope and half
    angle; `kept` (T, N) the readings that agree.
    """

    information: Float
    right: Float
    kept: Flags

    def solved(self) -> Float:
        """(T, 3) all three from the depth alone."""
        return np.asarray(np.linalg.solve(self.information, self.right[..., None])[..., 0])

    def given(self, half_change: Float) -> _Given:
        """Value and slope for half angles known otherwise."""
        covariance = np.linalg.inv(self.information[:, :2, :2])
        coupling = -np.matmul(covariance, self.information[:, :2, 2:])[..., 0]
        line = np.matmul(covariance, self.right[:, :2, None])[..., 0]
        return _Given(line + coupling * half_change[:, None], covariance, coupling)


class _Given(NamedTuple):
    """Value and slope (T, 2) of `_Lines`, their covariance (T, 2, 2), and how they change with
    the half angle (T, 2).
    """

    line: Float
    covariance: Float
    coupling: Float


def fit_stems(
    readings: Readings,
    frames: AxisFrames,
    edges: StemEdges,
    lean_std_rad: float,
    settings: MeasureSettings,
) -> Stems:
    """Fit distance, tilt and half angle to the readings between the edges.

    Every reading gives a distance by itself, since the section says how far behind the foremost
    point it lies. Their inverse, in which the noise of stereo is the same at every distance, is
    linear in the height along the axis, with a slope that is the axis' tilt. How the readings
    fall back towards the edges tells the half angle once more.

    Args:
        readings: depth inside the stems' outlines.
        frames: the axes as the picture and the vertical give them.
        edges: what keypoints and masks tell of the stems' widths.
        lean_std_rad: how far the true axis may tilt from it, towards or away from the camera.
        settings: noise of the depth.
    """
    tilt = step = np.zeros(len(readings.depth_m))
    sections, sources = edges.sections(frames)
    for turn in range(_TURNS):
        points = _seen(sections, readings)
        noise = points.noise(settings)
        line = _level_lines(points) if turn else _best_lines(points, noise, lean_std_rad)
        lines = _fit_lines(
            points, line, noise, readings.per_error, tilt, lean_std_rad, _ROUNDS[turn > 0]
        )
        curvature = _curvature(lines, sections.half_rad + lines.solved()[:, 2], settings)
        half, shares = fuse([*sources, curvature])
        given = lines.given(half.rad - sections.half_rad)
        found = np.arctan(-given.line[:, 1] / given.line[:, 0])
        # Near, thick stems swing about their tilt: the last swing tells how far is too far.
        swing = np.where(step == 0, 0.0, np.clip(found / np.where(step == 0, 1.0, step), -0.9, 0.0))
        step = found / (1 - swing)
        tilt = tilt + step
        axis_points = sections.centre / given.line[:, :1]
        sections, sources = edges.sections(frames.tilted(np.tan(tilt)), half.rad)
        if np.nanmax(np.abs(step), initial=0.0) < _SETTLED_RAD:
            break
    bias = settings.depth_bias_per_m * _means(points.share, points.used)
    distance_m = (axis_points * sections.facing).sum(1)
    return _stems(
        sections,
        distance_m,
        given,
        half.std_rad,
        [*sources, curvature],
        shares,
        points,
        lines.kept,
        bias,
    )


def _stems(
    sections: Sections,
    distance: Float,
    given: _Given,
    half_std_rad: Float,
    sources: list[HalfAngle],
    shares: Float,
    points: _Points,
    kept: Flags,
    bias: Float,
) -> Stems:
    agreeing = kept.sum(1) / np.maximum(points.used.sum(1), 1)
    doubt = _DOUBT * (1 - agreeing) ** 2
    std = np.sqrt(np.diagonal(given.covariance, axis1=1, axis2=2))
    sides = [np.where(kept, sign * points.offset, -1.0).max(1, initial=-1.0) for sign in (1, -1)]
    arc = sum(np.arcsin(np.clip(side, -1, 1)) for side in sides)
    return Stems(
        sections,
        distance,
        np.hypot(np.hypot(std[:, 0], bias) * distance, doubt) * distance,
        std[:, 1] * np.abs(distance),
        half_std_rad,
        -given.coupling[:, 0] * distance,
        sources,
        shares,
        np.maximum(arc, 0.0),
        kept.sum(1),
        agreeing,
    )


class _Points(NamedTuple):
    """What each reading tells, (T, N): `height` along the axis from the section, per metre of
    distance; the `inverse` of the distance to the axis in 1/m, and its change per radian of a
    smaller half angle; the `offset`, `share` and depth it comes from; and whether it is `used`.
    """

    height: Float
    inverse: Float
    narrowing: Float
    offset: Float
    share: Float
    depth_m: Float
    used: Flags

    def noise(self, settings: MeasureSettings) -> Float:
        """(T,) standard deviation of the inverse distances, 1/m."""
        per_m = np.hypot(settings.depth_noise_per_m, settings.depth_noise_m / self.depth_m**2)
        return _means(self.share * per_m, self.used)


def _seen(sections: Sections, readings: Readings) -> _Points:
    view = sections.look(readings.rays)
    used = (view.share > 0) & (np.abs(view.offset) < USED_WIDTH) & (readings.depth_m > 0)
    depth_m = np.where(used, readings.depth_m, 1.0)
    height = np.where(used, view.height - sections.height[:, None], 0.0)
    narrowing = -view.share_slope / depth_m
    return _Points(height, view.share / depth_m, narrowing, view.offset, view.share, depth_m, used)


def _means(values: Float, used: Flags) -> Float:
    """(T,) mean of the used values."""
    return np.asarray(np.where(used, values, 0).sum(1) / np.maximum(used.sum(1), 1))


def _fit_lines(
    points: _Points,
    line: Float,
    noise: Float,
    per_error: Float,
    tilt: Float,
    lean_std_rad: float,
    rounds: int,
) -> _Lines:
    """Robust lines through inverse distances, their slopes held by a prior of the tilt.

    Reweighted least squares with Tukey's weights from a first `line` (T, 2).

    Args:
        points: what the readings say.
        line: first value and slope.
        noise: (T,) standard deviation of the inverse distances, 1/m.
        per_error: (T,) neighbours with one error.
        tilt: (T,) what the frame has been tilted by already, which the prior counts back.
        lean_std_rad: standard deviation of the tilt.
        rounds: how often the weights are taken anew.
    """
    basis = np.stack([np.ones_like(points.height), points.height, points.narrowing], 1)
    bend = _BEND_PER_M * points.height**2
    variance = np.ones(len(line))
    state = np.concatenate([line, np.zeros((len(line), 1))], 1)
    for _ in range(rounds):
        squared_noise = (variance * noise**2)[:, None]
        expected = np.sqrt(squared_noise + bend**2)
        ratio = (points.inverse - np.matmul(state[:, None], basis)[:, 0]) / expected
        tukey = np.where(points.used, np.maximum(1 - (ratio / _CUTOFF) ** 2, 0) ** 2, 0.0)
        weight = tukey / per_error[:, None]
        weighted = basis * (weight / expected**2)[:, None]
        # Only where noise rules, near the section, does the scatter tell the noise.
        vote = weight * squared_noise / expected**2
        spread = (vote * ratio**2).sum(1)
        variance = variance * (_NOISE_PRIOR + spread) / (_NOISE_PRIOR + vote.sum(1))
        information = np.matmul(weighted, basis.transpose(0, 2, 1))
        right = np.matmul(weighted, points.inverse[..., None])[..., 0]
        steepness = 1 / (np.tan(lean_std_rad) * np.abs(state[:, 0]) + 1e-9) ** 2
        information[:, 1, 1] += steepness
        right[:, 1] += steepness * np.tan(tilt) * state[:, 0]
        information[:, [0, 2], [0, 2]] += 1e-9
        lines = _Lines(information, right, tukey > 0)
        state[:, :2] = lines.given(np.zeros(len(line))).line
    return lines


def _curvature(lines: _Lines, rad: Float, settings: MeasureSettings) -> HalfAngle:
    """What the depth tells of the half angles by itself, no better than bark and bends let it."""
    variance = np.linalg.inv(lines.information)[:, 2, 2]
    std = np.sqrt(variance + (settings.curvature_std * rad) ** 2)
    plausible = (rad > 0) & (std < 0.5 * rad) & (lines.kept.sum(1) >= _LEAST_READINGS)
    return HalfAngle(np.where(plausible, rad, 1.0), np.where(plausible, std, np.inf))


def _level_lines(points: _Points) -> Float:
    """(T, 2) medians of the used inverse distances, and no slope."""
    value = medians(points.inverse, points.used)
    value = np.where(value > 0, value, 1.0)
    return np.stack([value, np.zeros(len(value))], 1)


def _best_lines(points: _Points, noise: Float, lean_std_rad: float) -> Float:
    """(T, 2) value and slope of the line that most readings support, of many slopes and values."""
    height, inverse, used = (
        part[:, ::_JUDGED] for part in (points.height, points.inverse, points.used)
    )
    count, scale = used.sum(1), _level_lines(points)[:, 0]
    allowed = _CUTOFF * np.hypot(noise[:, None], _BEND_PER_M * height**2)
    offsets = np.linspace(-_STEEPEST, _STEEPEST, _SLOPES)
    slopes = offsets * (np.tan(lean_std_rad) * scale)[:, None]
    levels = np.where(used[:, None], inverse[:, None] - slopes[..., None] * height[:, None], np.inf)
    ordered = np.sort(levels, axis=2)
    # Whether few or most readings are of what hides the stem, one of these lies on the stem.
    place = (_LEVELS * count[:, None]).astype(np.intp)[:, None]
    values = np.take_along_axis(ordered, np.broadcast_to(place, (*slopes.shape, len(_LEVELS))), 2)
    values = np.where(np.isfinite(values), values, 1.0)
    near = np.abs(levels[:, :, None] - values[..., None]) < allowed[:, None, None]
    support = near.sum(-1) - offsets[:, None] ** 2
    best = support.reshape(len(count), -1).argmax(1)
    value = values.reshape(len(count), -1)[np.arange(len(count)), best]
    return np.stack([value, slopes[np.arange(len(count)), best // len(_LEVELS)]], 1)
