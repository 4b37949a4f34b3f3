"""Where a stem stands: distance and tilt of its axis from the depth inside its edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.estimates import Failure
from edgetree.measure.section import AxisFrame, Section, tangent_section
from edgetree.measure.settings import MeasureSettings

__all__ = ["Readings", "Stem", "fit_stem"]

Float = NDArray[np.floating[Any]]

# Readings nearer to an edge than this share of the half width may be of the background.
_USED_WIDTH = 0.75
_LEAST_READINGS = 4
# Stems bend and taper: a straight one of constant radius is off by this share of the squared
# length (1/m), so that what is seen close to the section counts most.
_BEND_PER_M = 0.02
# The first line is sought among tilts up to so many standard deviations and these levels of the
# sorted readings, by the support among at least so many readings.
_STEEPEST = 6.0
_SLOPES = 15
_LEVELS = (0.15, 0.3, 0.5, 0.7, 0.85)
_JUDGES = 120
_TURNS = 3
_ROUNDS = 3
_CUTOFF = 4.0
# The assumed noise counts as much as this many independent readings.
_NOISE_PRIOR = 8.0


class Readings(NamedTuple):
    """Depth on one stem: `rays` (N, 3) with z = 1, `depth_m` (N,), and `cell` (N,), the same
    number where the sensor's errors are the same.
    """

    rays: Float
    depth_m: Float
    cell: NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class Stem:
    """A stem near its section.

    Attributes:
        section: its edges and axis.
        distance_m: from the camera to the axis at the section, across the axis.
        distance_std_m: its standard deviation.
        tilt_std_rad: standard deviation of the axis' angle towards or away from the camera.
        readings: how many independent readings it rests on.
    """

    section: Section
    distance_m: float
    distance_std_m: float
    tilt_std_rad: float
    readings: int

    @property
    def radius_m(self) -> float:
        """Radius at the section."""
        return self.distance_m * float(np.sin(self.section.half_angle_rad))

    def axis_point(self, ray: Float) -> Float:
        """(3,) point of the axis level with where a ray (3,) meets the front of the stem.

        Only the ray's height counts: what it lies off the axis' plane is taken as error.
        """
        section = self.section
        middle = section.centre - section.height * section.frame.along
        slope = float(ray @ section.frame.along) / float(ray @ middle)
        front = slope * section.front_share * section.frame.along
        return np.asarray(self.distance_m * (middle + front))

    def front_point(self, ray: Float) -> Float:
        """(3,) point of the bark before `axis_point`."""
        section = self.section
        middle = section.centre - section.height * section.frame.along
        return np.asarray(self.axis_point(ray) - self.radius_m * middle)


class _Points(NamedTuple):
    """Per reading (N,): `height` along the axis from the section, per metre of distance, and the
    `inverse` of the distance to the axis in 1/m; `cell` as in `Readings`.
    """

    height: Float
    inverse: Float
    cell: NDArray[np.integer[Any]]


class _Line(NamedTuple):
    """1 / distance = at_section + slope * (height - the section's), and their covariance."""

    at_section: float
    slope: float
    covariance: Float
    cells: int


def fit_stem(
    readings: Readings,
    edges: tuple[Float, Float],
    frame: AxisFrame,
    lean_std_rad: float,
    settings: MeasureSettings,
) -> Stem | Failure:
    """Fit distance and tilt to the readings between the edges.

    Every reading gives a distance by itself, since the section says how far behind the foremost
    point it lies. Their inverse, in which the noise of stereo is the same at every distance, is
    linear in the height along the axis, with a slope that is the axis' tilt.

    Args:
        readings: depth inside the stem's mask.
        edges: rays (3,) that graze the stem left and right.
        frame: the axis as the picture and the vertical give it.
        lean_std_rad: how far the true axis may tilt from it, towards or away from the camera.
        settings: noise of the depth.
    """
    tilt_rad = 0.0
    section = tangent_section(frame, *edges)
    line = _Line(0.0, 0.0, np.zeros((2, 2)), 0)
    for turn in range(_TURNS):
        offset, share, height = section.look(readings.rays)
        used = (share > 0) & (np.abs(offset) < max(_USED_WIDTH, _closest(offset)))
        if np.count_nonzero(used) < _LEAST_READINGS:
            return Failure("no depth on the stem")
        points = _Points(
            height[used] - section.height, share[used] / readings.depth_m[used], readings.cell[used]
        )
        noise = settings.depth_noise_per_m * float(share[used].mean())
        found = _fit_line(points, noise, (-tilt_rad, lean_std_rad), turn == 0)
        if found is None:
            return Failure("the depth on the stem does not agree with itself")
        line = found
        tilt_rad += float(np.arctan(-line.slope / line.at_section))
        section = tangent_section(frame.tilted(float(np.tan(tilt_rad))), *edges)
    if section.centre[2] <= 0:
        return Failure("the diameter keypoints do not lie on the stem")
    distance_m = 1 / line.at_section
    std = np.sqrt(np.diag(line.covariance))
    return Stem(
        section, distance_m, float(std[0]) * distance_m**2, float(std[1]) * distance_m, line.cells
    )


def _closest(offset: Float) -> float:
    """A little more than the smallest |offset|: a stem of one pixel's width has that pixel."""
    return min(0.95, float(np.abs(offset).min(initial=1.0)) + 1e-6)


def _fit_line(
    points: _Points, noise: float, tilt_prior: tuple[float, float], search: bool
) -> _Line | None:
    """Robust line through inverse distances, its slope held by a prior of the tilt.

    Of many lines through two readings the one that most others support is taken first (only
    where `search`: later turns start level), then reweighted least squares with Tukey's weights.
    Readings of one cell count as one.

    Args:
        points: what the readings say.
        noise: standard deviation of the inverse distances, 1/m.
        tilt_prior: mean and standard deviation of the tilt, radians.
        search: whether the line may be far from the median and the prior.
    """
    height, inverse, cell = points
    scale = float(np.median(inverse))
    expected = np.hypot(noise, _BEND_PER_M * height**2)
    mean, std = (float(np.tan(angle)) * scale for angle in tilt_prior)
    line: Float = np.array([scale, 0.0])
    if search:
        line = _best_line(points, expected, mean, std)
    basis = np.stack([np.ones_like(height), height])
    variance, kept = 1.0, np.zeros(len(height), np.bool_)
    covariance: Float = np.zeros((2, 2))
    for _ in range(_ROUNDS):
        ratio = (inverse - line @ basis) / expected
        tukey = np.maximum(1 - (ratio / (_CUTOFF * np.sqrt(variance))) ** 2, 0) ** 2
        kept = tukey > 0
        if np.count_nonzero(kept) < _LEAST_READINGS:
            return None
        weight = tukey / _shared(cell, kept)
        variance = (_NOISE_PRIOR + float(weight @ ratio**2)) / (_NOISE_PRIOR + float(weight.sum()))
        weight = weight / (variance * expected**2)
        information = (basis * weight) @ basis.T
        information[1, 1] += 1 / std**2
        right = basis @ (weight * inverse)
        right[1] += mean / std**2
        covariance = _inverse(information)
        line = covariance @ right
    if line[0] <= 0:
        return None
    cells = int(np.count_nonzero(np.bincount(cell[kept])))
    return _Line(float(line[0]), float(line[1]), covariance, cells)


def _inverse(matrix: Float) -> Float:
    """Of a symmetric (2, 2) matrix."""
    (a, b), (_, c) = matrix
    return np.asarray(np.array([[c, -b], [-b, a]]) / (a * c - b * b))


def _shared(cell: NDArray[np.integer[Any]], kept: NDArray[np.bool_]) -> Float:
    """(N,) how many of the kept readings lie in the cell of each reading, at least 1."""
    counts = np.bincount(cell, weights=kept)
    return np.asarray(np.maximum(counts[cell], 1.0))


def _best_line(points: _Points, expected: Float, mean: float, std: float) -> Float:
    """(2,) value and slope of the line that most readings support, of many slopes and values."""
    some = slice(None, None, max(1, len(points.height) // _JUDGES))
    height, inverse, allowed = points.height[some], points.inverse[some], _CUTOFF * expected[some]
    offsets = np.linspace(-_STEEPEST, _STEEPEST, _SLOPES)
    slopes = mean + offsets * std
    levels = inverse - slopes[:, None] * height
    ordered = np.sort(levels, axis=1)
    # Whether few or most readings are of what hides the stem, one of these lies on the stem.
    values = ordered[:, (np.array(_LEVELS) * len(height)).astype(int)]
    support = (np.abs(levels[:, None] - values[..., None]) < allowed).sum(-1)
    best = np.unravel_index(np.argmax(support - offsets[:, None] ** 2), support.shape)
    return np.array([values[best], slopes[best[0]]])
