"""Fit distance, tilt and width of stems to depth readings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.measure.constants.depth import (
    DISAGREEMENT_STD,
    MAX_CURVATURE_STD,
    MAX_USED_OFFSET,
    MIN_READINGS,
    UNREAD_STD,
)
from edgetree.measure.convergence import Convergence
from edgetree.measure.distance_lines import (
    InverseDistances,
    NormalEquations,
    best_distance_lines,
    fit_distance_lines,
    level_distance_lines,
    masked_means,
)
from edgetree.measure.section import Sections, StemAxes
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.width import HalfAngle, StemEdges, fuse

# Repetitions of the fit, until all tilts change by less than this.
_ITERATIONS = 5
_CONVERGED_RAD = 3e-3
# The taper is estimated in so many of them.
_TAPER_ITERATIONS = 2
# Rounds of reweighted least squares in the first and in later repetitions.
_ROUNDS = (3, 2)


class Readings(NamedTuple):
    """Depth readings on T stems.

    Attributes:
        rays: (T, N, 3) viewing rays with z = 1.
        depth_m: (T, N) depth z in metres; 0 where there is no reading.
        readings_per_error: (T,) number of neighbouring readings that share one sensor error.
    """

    rays: Float
    depth_m: Float
    readings_per_error: Float


@dataclass(frozen=True, eq=False, kw_only=True)
class Stems:
    """Fitted stems, T at once. All distances are across the axis, from the camera to the axis.

    Attributes:
        sections: Cross-sections and axes.
        distance_m: (T,) distance to the axis at the section.
        distance_std_m: (T,) its standard deviation.
        tilt_std_rad: (T,) standard deviation of the axis' angle towards or away from the camera.
        half_std_rad: (T,) standard deviation of the half angle.
        distance_change_per_rad: (T,) relative change of the distance per radian of half angle.
        sources: Half angles from keypoints, masks and depth curvature, each by itself.
        weights: (3, T) weights of these sources in the half angle.
        arc_rad: (T,) arc of the stem's circumference that the readings cover.
        used: (T,) number of readings that agree with the stem.
        agreeing: (T,) their fraction of the readings between the edges.
        distance_tilt_m_rad: (T,) covariance of the distance's error with that of its change per
            metre along the axis. It is negative where the readings lie above the section.
        size_std: (T,) relative standard deviation of lengths across the view at the stems; None
            where it is that of the distance.
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
    used: Index
    agreeing: Float
    distance_tilt_m_rad: Float
    size_std: Float | None = None

    @cached_property
    def fitted(self) -> Bool:
        """(T,) whether the fit succeeded."""
        sound = np.isfinite(self.distance_m) & (self.distance_m > 0)
        return np.asarray(sound & (self.used >= MIN_READINGS) & (self.sections.centre[:, 2] > 0))

    @cached_property
    def relative_size_std(self) -> Float:
        """(T,) relative standard deviation of lengths across the view, without that of the rig."""
        if self.size_std is not None:
            return self.size_std
        return np.asarray(self.distance_std_m / self.distance_m)

    @cached_property
    def disagreement(self) -> Float:
        """(T,) Birge ratio of the sources of the half angle: 1 where they agree, or more."""
        information = np.sum([1 / source.std_rad**2 for source in self.sources], axis=0)
        return np.asarray(np.maximum(self.half_std_rad * np.sqrt(information), 1.0))

    @cached_property
    def radius_m(self) -> Float:
        """(T,) radius at the section."""
        return np.asarray(self.distance_m * np.sin(self.sections.half_rad))


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
        readings: Depth readings within the stems' outlines.
        axes: The axes from image and vertical.
        edges: The stems' edges from keypoints and masks.
        lean_std_rad: Standard deviation of the tilt towards or away from the camera.
        settings: Noise of the depth.
    """
    tilt = step = np.zeros(len(readings.depth_m))
    sections, sources, widths = edges.sections(axes)
    kept: Bool | None = None
    for iteration in range(_ITERATIONS):
        points = _inverse_distances(sections, readings)
        noise = points.noise(settings)
        if iteration < _TAPER_ITERATIONS:
            convergence = Convergence.of(widths, edges.distance_m)
        if kept is None:
            start = best_distance_lines(
                points.height_ratio,
                points.inverse,
                points.used,
                noise,
                lean_std_rad,
                convergence,
            )
        else:
            start = level_distance_lines(points, kept)
        equations = fit_distance_lines(
            points,
            start,
            noise,
            readings_per_error=readings.readings_per_error,
            tilt=tilt,
            lean_std_rad=lean_std_rad,
            rounds=_ROUNDS[iteration > 0],
        )
        kept = equations.kept
        curvature = _curvature(equations, sections.half_rad + equations.solve()[:, 2], settings)
        half, weights = fuse([*sources, curvature])
        lines = equations.solve_line(half.rad - sections.half_rad)
        value, slope = lines.value_slope.T
        receding = _receding(points, half.rad)
        # Later it stays, as it depends on the tilt in turn.
        if iteration < _TAPER_ITERATIONS:
            taper_per_m = convergence.taper_per_m(value, slope, receding)
        found = np.arctan(-(slope + taper_per_m * receding) / value)
        # For near, thick stems the steps of the tilt alternate in sign and shrink by a constant
        # ratio. The sum of this geometric series is the limit.
        ratio = np.where(step == 0, 0.0, np.clip(found / np.where(step == 0, 1.0, step), -0.9, 0.0))
        step = found / (1 - ratio)
        tilt = tilt + step
        axis_points = sections.centre / value[:, None]
        sections, sources, widths = edges.sections(axes.tilted(np.tan(tilt)), half.rad)
        if np.fmax.reduce(np.abs(step), initial=0.0) < _CONVERGED_RAD:
            break
    distance_m = (axis_points * sections.view_direction).sum(1)
    agreeing = equations.kept.sum(1) / np.maximum(points.used.sum(1), 1)
    std = np.sqrt(np.diagonal(lines.covariance, axis1=1, axis2=2))
    bias = settings.depth_bias_per_m * masked_means(points.depth_ratio, points.used)
    bias = np.hypot(bias, settings.depth_bias_m / np.where(distance_m > 0, distance_m, 1.0) ** 2)
    unread = 1 - equations.kept.mean(1)
    doubt = np.hypot(DISAGREEMENT_STD * (1 - agreeing) ** 2, UNREAD_STD * unread**2)
    # First-order error propagation: the relative error of a distance d is d times the error of its
    # inverse. The slope divided by the inverse distance is the tangent of the tilt. At the height h
    # above the section the distance has the error -d² (value + slope h / d).
    return Stems(
        sections=sections,
        distance_m=distance_m,
        distance_std_m=np.hypot(np.hypot(std[:, 0], bias) * distance_m, doubt) * distance_m,
        tilt_std_rad=std[:, 1] * np.abs(distance_m),
        half_std_rad=half.std_rad,
        distance_change_per_rad=-lines.per_half_rad[:, 0] * distance_m,
        sources=[*sources, curvature],
        weights=weights,
        arc_rad=_covered_arc_rad(points, equations.kept),
        used=equations.kept.sum(1),
        agreeing=agreeing,
        distance_tilt_m_rad=lines.covariance[:, 0, 1] * np.abs(distance_m) ** 3,
    )


def _covered_arc_rad(points: InverseDistances, kept: Bool) -> Float:
    """(T,) arc between the outermost kept readings.

    `points.offset` is about the sine of the angle at the stem's centre, exactly so from afar.
    """
    sides = [np.where(kept, sign * points.offset, -1.0).max(1, initial=-1.0) for sign in (1, -1)]
    arc = sum(np.arcsin(np.clip(side, -1, 1)) for side in sides)
    return np.asarray(np.maximum(arc, 0.0))


def _inverse_distances(sections: Sections, readings: Readings) -> InverseDistances:
    view = sections.view(readings.rays)
    used = (view.depth_ratio > 0) & (np.abs(view.offset) < MAX_USED_OFFSET) & (readings.depth_m > 0)
    depth_m = np.where(used, readings.depth_m, 1.0)
    height_ratio = np.where(used, view.height_ratio - sections.height_ratio[:, None], 0.0)
    return InverseDistances(
        height_ratio=height_ratio,
        inverse=view.depth_ratio / depth_m,
        per_narrowing=-view.depth_ratio_slope / depth_m,
        offset=view.offset,
        depth_ratio=view.depth_ratio,
        depth_m=depth_m,
        used=used,
    )


def _receding(points: InverseDistances, half_rad: Float) -> Float:
    """(T,) by how much a taper of 1 per metre lowers the inverse distance per height ratio.

    The bark of a stem that gets thinner upwards recedes from the camera.
    """
    per_rad = points.per_narrowing / np.maximum(points.inverse, 1e-6)
    return half_rad * masked_means(per_rad, points.used)


def _curvature(equations: NormalEquations, rad: Float, settings: MeasureSettings) -> HalfAngle:
    """The half angles `rad` (T,) from the depth alone, with their standard deviations.

    Bark and bends limit the accuracy to `MeasureSettings.curvature_std`.
    """
    variance = np.linalg.inv(equations.information)[:, 2, 2]
    std = np.sqrt(variance + (settings.curvature_std * rad) ** 2)
    plausible = (
        (rad > 0) & (std < MAX_CURVATURE_STD * rad) & (equations.kept.sum(1) >= MIN_READINGS)
    )
    return HalfAngle(np.where(plausible, rad, 1.0), np.where(plausible, std, np.inf))
