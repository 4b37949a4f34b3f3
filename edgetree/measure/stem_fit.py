"""Fit distance, tilt and width of stems to depth readings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.edge_lines import masked_medians
from edgetree.measure.section import Sections, StemAxes
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.width import HalfAngle, StemEdges, fuse

__all__ = ["MAX_USED_OFFSET", "Readings", "Stems", "fit_stems"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

MAX_USED_OFFSET = 0.8
"""Readings further from the middle than this, 1 at the edge, may show the background."""

_MIN_READINGS = 4
# Error of a straight stem of constant radius: real stems bend and taper. In 1/m, times the square
# of the height from the section in metres, so that readings near the section count most.
_BEND_PER_M = 0.02
# Candidates for the first line: this many tilts, up to this many standard deviations of the lean,
# through these quantiles of the readings. Their support is counted on every fourth reading.
_MAX_TILT_STDS = 6.0
_SLOPES = 15
_QUANTILES = np.array((0.15, 0.3, 0.5, 0.7, 0.85))
_SUPPORT_STEP = 4
# Repetitions of the fit, until all tilts change by less than this.
_ITERATIONS = 5
_CONVERGED_RAD = 3e-3
# Rounds of reweighted least squares in the first and in later repetitions, and the residual in
# standard deviations from which Tukey's biweight is 0.
_ROUNDS = (3, 2)
_CUTOFF = 4.0
# Relative standard deviation of the distance, times the squared fraction of readings that
# disagree: these may show the stem, and the others an object in front of it.
_DISAGREEMENT_STD = 0.5
# Weight of the assumed noise when it is adjusted, in independent readings.
_NOISE_PRIOR = 8.0


class Readings(NamedTuple):
    """Depth readings on T stems.

    Attributes:
        rays: (T, N, 3) viewing rays with z = 1.
        depth_m: (T, N) depth z in metres; 0 where there is no reading.
        per_error: (T,) number of neighbouring readings that share one sensor error.
    """

    rays: Float
    depth_m: Float
    per_error: Float


@dataclass(frozen=True, eq=False, kw_only=True)
class Stems:
    """Fitted stems, T at once. All distances are across the axis, from the camera to the axis.

    Attributes:
        sections: cross-sections and axes.
        distance_m: (T,) distance to the axis at the section.
        distance_std_m: (T,) its standard deviation.
        tilt_std_rad: (T,) standard deviation of the axis' angle towards or away from the camera.
        half_std_rad: (T,) standard deviation of the half angle.
        distance_change_per_rad: (T,) relative change of the distance per radian of half angle.
        sources: half angles from keypoints, masks and depth curvature, each by itself.
        weights: (T, 3) weights of these sources in the half angle.
        arc_rad: (T,) arc of the stem's circumference that the readings cover.
        used: (T,) number of readings that agree with the stem.
        agreeing: (T,) their fraction of the readings between the edges.
    """

    sections: Sections
    distance_m: Float
    distance_std_m: Float
    tilt_std_rad: Float
    half_std_rad: Float
    distance_change_per_rad: Float
    sources: list[HalfAngle]
    weights: Float
    arc_rad: Float
    used: NDArray[np.intp]
    agreeing: Float

    @cached_property
    def fitted(self) -> Flags:
        """(T,) whether the fit succeeded."""
        sound = np.isfinite(self.distance_m) & (self.distance_m > 0)
        return np.asarray(sound & (self.used >= _MIN_READINGS) & (self.sections.centre[:, 2] > 0))

    @cached_property
    def radius_m(self) -> Float:
        """(T,) radius at the section."""
        return np.asarray(self.distance_m * np.sin(self.sections.half_rad))


@dataclass(eq=False)
class _NormalEquations:
    """Normal equations of the linear model of the inverse distances, 1/m.

    inverse = value + slope * height_ratio + per_narrowing * (half angle - assumed half angle)

    Attributes:
        information: (T, 3, 3) normal matrix of value, slope and half angle change.
        right: (T, 3) right-hand side.
        kept: (T, N) readings with a weight above 0.
    """

    information: Float
    right: Float
    kept: Flags

    def solve(self) -> Float:
        """(T, 3) value, slope and half angle change from the depth alone."""
        return np.asarray(np.linalg.solve(self.information, self.right[..., None])[..., 0])

    def solve_line(self, half_change: Float) -> _Lines:
        """Value and slope for known changes (T,) of the half angle."""
        covariance = np.linalg.inv(self.information[:, :2, :2])
        per_half_rad = -np.matmul(covariance, self.information[:, :2, 2:])[..., 0]
        line = np.matmul(covariance, self.right[:, :2, None])[..., 0]
        return _Lines(line + per_half_rad * half_change[:, None], covariance, per_half_rad)


class _Lines(NamedTuple):
    """Lines of inverse distance over height, for known half angles.

    Attributes:
        value_slope: (T, 2) value at the section and slope.
        covariance: (T, 2, 2) their covariance.
        per_half_rad: (T, 2) their change per radian of half angle.
    """

    value_slope: Float
    covariance: Float
    per_half_rad: Float


class _InverseDistances(NamedTuple):
    """What each reading says about its stem's distance, each array (T, N).

    Attributes:
        height_ratio: height along the axis above the section, per metre of distance.
        inverse: inverse distance to the axis, 1/m.
        per_narrowing: change of `inverse` per radian of decrease of the half angle.
        offset: lateral position on the stem, see `StemView.offset`.
        depth_ratio: depth per metre of distance to the axis, see `StemView.depth_ratio`.
        depth_m: depth; 1 where the reading is not used.
        used: whether the reading is used.
    """

    height_ratio: Float
    inverse: Float
    per_narrowing: Float
    offset: Float
    depth_ratio: Float
    depth_m: Float
    used: Flags

    def noise(self, settings: MeasureSettings) -> Float:
        """(T,) mean standard deviation of the inverse distances, 1/m.

        A depth error e changes the inverse depth by e / z² to first order. With an error of
        a z² (stereo) or b (time of flight), that is a or b / z².
        """
        per_m = np.hypot(settings.depth_noise_per_m, settings.depth_noise_m / self.depth_m**2)
        return _means(self.depth_ratio * per_m, self.used)


def fit_stems(
    readings: Readings,
    axes: StemAxes,
    edges: StemEdges,
    lean_std_rad: float,
    settings: MeasureSettings,
) -> Stems:
    """Fit distance, tilt and half angle to the depth readings between the edges.

    Each reading gives a distance to the axis by itself, because the section tells how far the
    surface point is in front of the axis. The inverse of this distance is used because its noise
    does not depend on the distance for stereo cameras, and because it is linear in the height
    along the axis: slope / value is the negative tangent of the tilt. The curvature of the depth
    across the stem gives one more estimate of the half angle.

    Args:
        readings: depth readings within the stems' outlines.
        axes: the axes from image and vertical.
        edges: the stems' edges from keypoints and masks.
        lean_std_rad: standard deviation of the tilt towards or away from the camera.
        settings: noise of the depth.
    """
    tilt = step = np.zeros(len(readings.depth_m))
    sections, sources = edges.sections(axes)
    for iteration in range(_ITERATIONS):
        points = _inverse_distances(sections, readings)
        noise = points.noise(settings)
        start = _level_lines(points) if iteration else _best_lines(points, noise, lean_std_rad)
        equations = _fit_lines(
            points,
            start,
            noise,
            per_error=readings.per_error,
            tilt=tilt,
            lean_std_rad=lean_std_rad,
            rounds=_ROUNDS[iteration > 0],
        )
        curvature = _curvature(equations, sections.half_rad + equations.solve()[:, 2], settings)
        half, weights = fuse([*sources, curvature])
        lines = equations.solve_line(half.rad - sections.half_rad)
        found = np.arctan(-lines.value_slope[:, 1] / lines.value_slope[:, 0])
        # For near, thick stems the steps of the tilt alternate in sign and shrink by a constant
        # ratio. The sum of this geometric series is the limit.
        ratio = np.where(step == 0, 0.0, np.clip(found / np.where(step == 0, 1.0, step), -0.9, 0.0))
        step = found / (1 - ratio)
        tilt = tilt + step
        axis_points = sections.centre / lines.value_slope[:, :1]
        sections, sources = edges.sections(axes.tilted(np.tan(tilt)), half.rad)
        if np.nanmax(np.abs(step), initial=0.0) < _CONVERGED_RAD:
            break
    distance_m = (axis_points * sections.view_direction).sum(1)
    agreeing = equations.kept.sum(1) / np.maximum(points.used.sum(1), 1)
    std = np.sqrt(np.diagonal(lines.covariance, axis1=1, axis2=2))
    bias = settings.depth_bias_per_m * _means(points.depth_ratio, points.used)
    disagreement = _DISAGREEMENT_STD * (1 - agreeing) ** 2
    return Stems(
        sections=sections,
        distance_m=distance_m,
        distance_std_m=np.hypot(np.hypot(std[:, 0], bias) * distance_m, disagreement) * distance_m,
        tilt_std_rad=std[:, 1] * np.abs(distance_m),
        half_std_rad=half.std_rad,
        distance_change_per_rad=-lines.per_half_rad[:, 0] * distance_m,
        sources=[*sources, curvature],
        weights=weights,
        arc_rad=_covered_arc_rad(points, equations.kept),
        used=equations.kept.sum(1),
        agreeing=agreeing,
    )


def _covered_arc_rad(points: _InverseDistances, kept: Flags) -> Float:
    """(T,) arc between the outermost kept readings.

    `points.offset` is about the sine of the angle at the stem's centre, exactly so from afar.
    """
    sides = [np.where(kept, sign * points.offset, -1.0).max(1, initial=-1.0) for sign in (1, -1)]
    arc = sum(np.arcsin(np.clip(side, -1, 1)) for side in sides)
    return np.asarray(np.maximum(arc, 0.0))


def _inverse_distances(sections: Sections, readings: Readings) -> _InverseDistances:
    view = sections.view(readings.rays)
    used = (view.depth_ratio > 0) & (np.abs(view.offset) < MAX_USED_OFFSET) & (readings.depth_m > 0)
    depth_m = np.where(used, readings.depth_m, 1.0)
    height_ratio = np.where(used, view.height_ratio - sections.height_ratio[:, None], 0.0)
    return _InverseDistances(
        height_ratio=height_ratio,
        inverse=view.depth_ratio / depth_m,
        per_narrowing=-view.depth_ratio_slope / depth_m,
        offset=view.offset,
        depth_ratio=view.depth_ratio,
        depth_m=depth_m,
        used=used,
    )


def _means(values: Float, used: Flags) -> Float:
    """(T,) means of the used ones among (T, N) values; 0 where there are none."""
    return np.asarray(np.where(used, values, 0).sum(1) / np.maximum(used.sum(1), 1))


def _fit_lines(
    points: _InverseDistances,
    start: Float,
    noise: Float,
    *,
    per_error: Float,
    tilt: Float,
    lean_std_rad: float,
    rounds: int,
) -> _NormalEquations:
    """Robust lines through the inverse distances, with a normal prior on their tilt.

    Iteratively reweighted least squares with Tukey's biweights. The noise is adjusted to the
    scatter of the readings; the assumed noise counts as `_NOISE_PRIOR` readings.

    Args:
        points: inverse distances.
        start: (T, 2) value and slope to start from.
        noise: (T,) standard deviation of the inverse distances, 1/m.
        per_error: (T,) number of readings that share one error.
        tilt: (T,) tilt that the axes already have, in radians; the prior refers to a tilt of 0.
        lean_std_rad: standard deviation of the tilt.
        rounds: number of times the weights are updated.
    """
    basis = np.stack(
        [np.ones_like(points.height_ratio), points.height_ratio, points.per_narrowing], 1
    )
    bend = _BEND_PER_M * points.height_ratio**2
    variance = np.ones(len(start))
    state = np.concatenate([start, np.zeros((len(start), 1))], 1)
    for _ in range(rounds):
        squared_noise = (variance * noise**2)[:, None]
        expected = np.sqrt(squared_noise + bend**2)
        residual = (points.inverse - np.matmul(state[:, None], basis)[:, 0]) / expected
        biweight = np.where(points.used, np.maximum(1 - (residual / _CUTOFF) ** 2, 0) ** 2, 0.0)
        weight = biweight / per_error[:, None]
        weighted = basis * (weight / expected**2)[:, None]
        # A reading counts in the adjustment of the noise as far as noise, not bend, dominates it.
        noise_weight = weight * squared_noise / expected**2
        scatter = (noise_weight * residual**2).sum(1)
        variance = variance * (_NOISE_PRIOR + scatter) / (_NOISE_PRIOR + noise_weight.sum(1))
        information = np.matmul(weighted, basis.transpose(0, 2, 1))
        right = np.matmul(weighted, points.inverse[..., None])[..., 0]
        # The prior: slope / value has mean tan(tilt) and standard deviation tan(lean_std_rad).
        prior = 1 / (np.tan(lean_std_rad) * np.abs(state[:, 0]) + 1e-9) ** 2
        information[:, 1, 1] += prior
        right[:, 1] += prior * np.tan(tilt) * state[:, 0]
        information[:, [0, 2], [0, 2]] += 1e-9
        equations = _NormalEquations(information, right, biweight > 0)
        state[:, :2] = equations.solve_line(np.zeros(len(start))).value_slope
    return equations


def _curvature(equations: _NormalEquations, rad: Float, settings: MeasureSettings) -> HalfAngle:
    """The half angles `rad` (T,) from the depth alone, with their standard deviations.

    Bark and bends limit the accuracy to `MeasureSettings.curvature_std`.
    """
    variance = np.linalg.inv(equations.information)[:, 2, 2]
    std = np.sqrt(variance + (settings.curvature_std * rad) ** 2)
    plausible = (rad > 0) & (std < 0.5 * rad) & (equations.kept.sum(1) >= _MIN_READINGS)
    return HalfAngle(np.where(plausible, rad, 1.0), np.where(plausible, std, np.inf))


def _level_lines(points: _InverseDistances) -> Float:
    """(T, 2) medians of the used inverse distances, and slope 0."""
    value = masked_medians(points.inverse, points.used)
    value = np.where(value > 0, value, 1.0)
    return np.stack([value, np.zeros(len(value))], 1)


def _best_lines(points: _InverseDistances, noise: Float, lean_std_rad: float) -> Float:
    """(T, 2) value and slope of the candidate line with the most readings near it.

    The candidates have several slopes and go through several quantiles of the readings. So one of
    them lies on the stem even if most readings belong to an object in front of it.
    """
    height, inverse, used = (
        part[:, ::_SUPPORT_STEP] for part in (points.height_ratio, points.inverse, points.used)
    )
    count, scale = used.sum(1), _level_lines(points)[:, 0]
    allowed = _CUTOFF * np.hypot(noise[:, None], _BEND_PER_M * height**2)
    tilt_stds = np.linspace(-_MAX_TILT_STDS, _MAX_TILT_STDS, _SLOPES)
    slopes = tilt_stds * (np.tan(lean_std_rad) * scale)[:, None]
    values = np.where(used[:, None], inverse[:, None] - slopes[..., None] * height[:, None], np.inf)
    ordered = np.sort(values, axis=2)
    rank = (_QUANTILES * count[:, None]).astype(np.intp)[:, None]
    shape = (*slopes.shape, len(_QUANTILES))
    candidates = np.take_along_axis(ordered, np.broadcast_to(rank, shape), 2)
    candidates = np.where(np.isfinite(candidates), candidates, 1.0)
    near = np.abs(values[:, :, None] - candidates[..., None]) < allowed[:, None, None]
    # The squared tilt is the penalty of a normal prior.
    support = near.sum(-1) - tilt_stds[:, None] ** 2
    best = support.reshape(len(count), -1).argmax(1)
    rows = np.arange(len(count))
    value = candidates.reshape(len(count), -1)[rows, best]
    return np.stack([value, slopes[rows, best // len(_QUANTILES)]], 1)
