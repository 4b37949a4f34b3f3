"""Robust lines of inverse distance over height along the axis, for T stems at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from edgetree.measure.constants.depth import NOISE_PRIOR_READINGS
from edgetree.measure.constants.stems import STEM_BEND_PER_M
from edgetree.measure.convergence import Convergence
from edgetree.measure.edge_lines import masked_medians
from edgetree.measure.settings import MeasureSettings

# Candidates for the first line: tilts in standard deviations of the lean, closer together around
# upright, through these quantiles of the readings. Their support is counted on every fourth
# reading.
_TILT_STDS = 3.2 * np.sinh(np.linspace(-2.0, 2.0, 17))
_QUANTILES = np.array((0.15, 0.3, 0.5, 0.7, 0.85))
_SUPPORT_STEP = 4
# A nearer candidate needs this fraction of the readings in each of so many parts of the length.
_MIN_NEARER, _PARTS = 0.15, 4
# Degrees of freedom of Student's t distribution of the tilt: a few stems lean far.
_TILT_FREEDOM = 4.0
# Residual in standard deviations from which Tukey's biweight is 0.
_CUTOFF = 4.0
# Added to the information on value and half angle, so that the equations can be solved.
_RIDGE = np.diag([1e-9, 0.0, 1e-9])


class InverseDistances(NamedTuple):
    """What each reading says about its stem's distance, each array (T, N).

    Attributes:
        height_ratio: Height along the axis above the section, per metre of distance.
        inverse: Inverse distance to the axis, 1/m.
        per_narrowing: Change of `inverse` per radian of decrease of the half angle.
        offset: Lateral position on the stem, see `StemView.offset`.
        depth_ratio: Depth per metre of distance to the axis, see `StemView.depth_ratio`.
        depth_m: Depth; 1 where the reading is not used.
        used: Whether the reading is used.
    """

    height_ratio: Float
    inverse: Float
    per_narrowing: Float
    offset: Float
    depth_ratio: Float
    depth_m: Float
    used: Bool

    def noise(self, settings: MeasureSettings) -> Float:
        """(T,) mean standard deviation of the inverse distances, 1/m.

        A depth error e changes the inverse depth by e / z² to first order. With an error of
        a z² (stereo) or b (time of flight), that is a or b / z².
        """
        per_m = np.hypot(settings.depth_noise_per_m, settings.depth_noise_m / self.depth_m**2)
        return masked_means(self.depth_ratio * per_m, self.used)


@dataclass(eq=False)
class NormalEquations:
    """Normal equations of the linear model of the inverse distances, 1/m.

    inverse = value + slope * height_ratio + per_narrowing * (half angle - assumed half angle)

    Attributes:
        information: (T, 3, 3) normal matrix of value, slope and half angle change.
        right: (T, 3) right-hand side.
        kept: (T, N) readings with a weight above 0.
    """

    information: Float
    right: Float
    kept: Bool

    def solve(self) -> Float:
        """(T, 3) value, slope and half angle change from the depth alone."""
        return np.asarray(np.linalg.solve(self.information, self.right[..., None])[..., 0])

    def solve_line(self, half_change: Float) -> DistanceLines:
        """Value and slope for known changes (T,) of the half angle."""
        covariance = np.linalg.inv(self.information[:, :2, :2])
        per_half_rad = -np.matmul(covariance, self.information[:, :2, 2:])[..., 0]
        line = np.matmul(covariance, self.right[:, :2, None])[..., 0]
        return DistanceLines(line + per_half_rad * half_change[:, None], covariance, per_half_rad)


class DistanceLines(NamedTuple):
    """Lines of inverse distance over height, for known half angles.

    Attributes:
        value_slope: (T, 2) value at the section and slope.
        covariance: (T, 2, 2) their covariance.
        per_half_rad: (T, 2) their change per radian of half angle.
    """

    value_slope: Float
    covariance: Float
    per_half_rad: Float


def fit_distance_lines(
    points: InverseDistances,
    start: Float,
    noise: Float,
    *,
    readings_per_error: Float,
    tilt: Float,
    lean_std_rad: float,
    rounds: int,
) -> NormalEquations:
    """Robust lines through the inverse distances, with a heavy-tailed prior on their tilt.

    Iteratively reweighted least squares with Tukey's biweights. In each round:

    1. Expect noise, and the bend of stems: at the height h above the section it moves the bark by
       `STEM_BEND_PER_M` h² metres, and the inverse distance 1 / d by as much times 1 / d².
    2. Weigh each reading by how far it is off the line, and by how many share its error.
    3. Adjust the noise to the scatter of the readings. The assumed noise counts as
       `NOISE_PRIOR_READINGS` of them.
    4. Build the normal equations, add the prior on the tilt, and solve them.

    Args:
        points: Inverse distances.
        start: (T, 2) value and slope to start from.
        noise: (T,) standard deviation of the inverse distances, 1/m.
        readings_per_error: (T,) number of readings that share one error.
        tilt: (T,) tilt that the axes already have, in radians; the prior refers to a tilt of 0.
        lean_std_rad: Standard deviation of the tilt.
        rounds: Number of times the weights are updated.
    """
    ones = np.ones_like(points.height_ratio)
    model = np.stack([ones, points.height_ratio, points.per_narrowing, points.inverse], 1)
    basis = model[:, :3]
    slope, slope_std = np.tan(tilt), np.tan(lean_std_rad)
    squared_bend = (STEM_BEND_PER_M * points.height_ratio**2) ** 2
    share = np.where(points.used, 1 / readings_per_error[:, None], 0.0)
    variance = np.ones(len(start))
    state = np.concatenate([start, np.zeros((len(start), 1))], 1)
    for _ in range(rounds):
        squared_noise = (variance * noise**2)[:, None]
        expected = squared_noise + squared_bend
        off = points.inverse - np.matmul(state[:, None], basis)[:, 0]
        squared = off**2 / expected
        # Tukey's biweight by the expected variance.
        weight = np.maximum(1 - squared / _CUTOFF**2, 0) ** 2 * share / expected
        weighted = basis * weight[:, None]
        # A reading counts in the adjustment of the noise as far as noise, not bend, dominates it.
        noise_weight = weight * squared_noise
        scatter = np.vecdot(noise_weight, squared)
        variance *= NOISE_PRIOR_READINGS + scatter
        variance /= NOISE_PRIOR_READINGS + noise_weight.sum(1)
        equations = np.matmul(weighted, model.transpose(0, 2, 1))
        information, right = equations[..., :3], equations[..., 3]
        # The prior: slope / value has mean tan(tilt) and standard deviation tan(lean_std_rad). The
        # normal equations of Student's t weigh it less the further off it is.
        scale = slope_std * np.abs(state[:, 0]) + 1e-9
        squared_tilt = ((state[:, 1] - slope * state[:, 0]) / scale) ** 2
        prior = (_TILT_FREEDOM + 1) / (_TILT_FREEDOM + squared_tilt) / scale**2
        information += _RIDGE
        information[:, 1, 1] += prior
        right[:, 1] += prior * slope * state[:, 0]
        state[:, :2] = np.linalg.solve(information[:, :2, :2], right[:, :2, None])[..., 0]
    return NormalEquations(information, right, weight > 0)


def masked_means(values: Float, used: Bool) -> Float:
    """(T,) means of the used ones among (T, N) values; 0 where there are none."""
    return np.asarray(np.where(used, values, 0).sum(1) / np.maximum(used.sum(1), 1))


def level_distance_lines(points: InverseDistances, kept: Bool) -> Float:
    """(T, 2) medians of the used inverse distances (T, N) that are kept, and slope 0."""
    value = _medians(points.inverse, points.used & kept)
    return np.stack([value, np.zeros(len(value))], 1)


def _medians(inverse: Float, used: Bool) -> Float:
    value = masked_medians(inverse, used)
    return np.where(value > 0, value, 1.0)


def best_distance_lines(
    height_ratio: Float,
    inverse: Float,
    used: Bool,
    noise: Float,
    lean_std_rad: float,
    edges: Convergence | None = None,
) -> Float:
    """(T, 2) value and slope of the candidate line with the most readings near it.

    1. Candidates have several slopes and go through several quantiles of the readings. So one of
       them lies on the stem even if most readings belong to an object in front of it.
    2. Count the readings near each candidate, in parts along the stem.
    3. The candidate with the most of them is the best, less a penalty for its tilt, and
       for how far the edges are from converging accordingly.
    4. A candidate that is nearer all along wins if readings near it lie all along the stem: then
       the others show the background, as nothing is seen through a stem.

    Args:
        height_ratio: (T, N) heights, see `InverseDistances`.
        inverse: (T, N) inverse distances, 1/m.
        used: (T, N) which of them are used.
        noise: (T,) their standard deviations, 1/m.
        lean_std_rad: Standard deviation of a stem's lean.
        edges: How the stems' edges converge, if it is known.
    """
    height, inverse = height_ratio[:, ::_SUPPORT_STEP], inverse[:, ::_SUPPORT_STEP]
    used = used[:, ::_SUPPORT_STEP]
    count, scale = used.sum(1), _medians(inverse, used)
    allowed = _CUTOFF * np.hypot(noise[:, None], STEM_BEND_PER_M * height**2)
    slopes = _TILT_STDS * (np.tan(lean_std_rad) * scale)[:, None]
    values = np.where(used[:, None], inverse[:, None] - slopes[..., None] * height[:, None], np.inf)
    ordered = np.sort(values, axis=2)
    rank = (_QUANTILES * count[:, None]).astype(np.intp)[:, None]
    candidates = np.take_along_axis(ordered, rank, 2)
    candidates = np.where(np.isfinite(candidates), candidates, 1.0)
    # One quantile after the other, as the system gives and clears the memory of large arrays anew.
    within = _parts(height.shape[1])
    near_parts = np.stack(
        [
            np.matmul(np.abs(values - value[..., None]) < allowed[:, None], within)
            for value in np.moveaxis(candidates, -1, 0)
        ],
        2,
    )
    # The penalty of the prior, twice its negative logarithm.
    penalty = _minus_two_log_t(_TILT_STDS**2)[:, None]
    if edges is not None:
        penalty = penalty + _minus_two_log_t(edges.squared_misfit(candidates, slopes[..., None]))
    support = (near_parts.sum(-1) - penalty).reshape(len(count), -1)
    rows = np.arange(len(count))
    best = support.argmax(1)
    ends = np.stack([np.where(used, height, np.inf).min(1), np.where(used, height, -np.inf).max(1)])
    ends = np.where(np.isfinite(ends), ends, 0.0)[..., None, None]
    inverse_there = (candidates + slopes[..., None] * ends).reshape(2, len(count), -1)
    clearance = 2 * masked_means(allowed, used)[:, None]
    nearer = (inverse_there > inverse_there[:, rows, best][..., None] + clearance).all(0)
    all_along = (near_parts >= _MIN_NEARER * np.matmul(used, within)[:, None, None]).all(-1)
    nearer &= all_along.reshape(len(count), -1)
    best = np.where(nearer.any(1), np.where(nearer, support, -np.inf).argmax(1), best)
    value = candidates.reshape(len(count), -1)[rows, best]
    return np.stack([value, slopes[rows, best // len(_QUANTILES)]], 1)


def _minus_two_log_t(squared: Float) -> Float:
    """Minus twice the logarithm of Student's t density at squared deviations, 0 at 0."""
    return np.asarray((_TILT_FREEDOM + 1) * np.log1p(squared / _TILT_FREEDOM))


def _parts(count: int) -> Float:
    """(count, parts) 1 where a reading, of so many along the stem, is in a part of its length."""
    part = np.arange(count)[:, None] * _PARTS // count
    return np.asarray(part == np.arange(_PARTS), np.float32)
