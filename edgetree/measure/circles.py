"""Circles through slices of a dense point cloud: a second opinion on the diameters of stems.

Around each place of a stem's axis the points of a slice are seen along the axis, in sectors around
the centre. Points of one sector share the same bark, so that each sector, and not each point, is
one reading. A circle is fitted to the sectors by robust least squares; the scatter
of the sectors about it, and the arc that they cover, give its deviation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Float
from basetree.normal import MAD_TO_STD
from edgetree.measure.constants.circles import (
    LEAST_SCATTER_M,
    MIN_SECTOR_POINTS,
    MIN_SECTORS,
    SECTORS,
    SLICE_HALF_M,
    UNSEEN_SHAPE_STD,
)

# Points further from the axis than this many radii, and this much, are of something else.
_REACH, _REACH_M = 1.6, 0.05
_ROUNDS = 12
_STEP_M = 1e-4
# Residuals of more than so many deviations hardly count, and the standard deviation of a normal
# distribution per median of its absolute values.
_TOLERANCE = 2.5


class Circles(NamedTuple):
    """Circles at K places.

    Attributes:
        diameter_m: (K,) diameters.
        std_m: (K,) their standard deviations; infinite where there are too few points.
    """

    diameter_m: Float
    std_m: Float


def fit_circles(points_m: Float, centres_m: Float, along: Float, diameters_m: Float) -> Circles:
    """Fit a circle at each of K places of a stem.

    Args:
        points_m: (N, 3) points of the cloud.
        centres_m: (K, 3) points near the axis.
        along: (3,) unit vector of the axis.
        diameters_m: (K,) approximate diameters.
    """
    across = np.linalg.svd(along[None])[2][1:]
    flat, height_m = points_m @ across.T, points_m @ along
    order = np.argsort(height_m)
    flat, height_m = flat[order], height_m[order]
    found = Circles(np.array(diameters_m, np.float64), np.full(len(centres_m), np.inf))
    ends = centres_m @ along + np.array([[-SLICE_HALF_M], [SLICE_HALF_M]])
    first, last = np.searchsorted(height_m, ends)
    for index, centre_m in enumerate(centres_m @ across.T):
        radius_m = diameters_m[index] / 2
        xy_m = flat[first[index] : last[index]] - centre_m
        xy_m = xy_m[np.linalg.norm(xy_m, axis=1) < _REACH * radius_m + _REACH_M]
        circle = _fit(xy_m, radius_m)
        if circle is not None:
            found.diameter_m[index], found.std_m[index] = circle
    return found


def _fit(xy_m: Float, radius_m: float) -> tuple[float, float] | None:
    """Diameter and standard deviation of the circle through points (N, 2) around (0, 0)."""
    if len(xy_m) < MIN_SECTORS * MIN_SECTOR_POINTS:
        return None
    x, y, radius = 0.0, 0.0, radius_m
    for _ in range(_ROUNDS):
        sectors = _sectors(xy_m - [x, y], radius)
        if sectors is None:
            return None
        direction, off_m = sectors
        scatter_m = _scatter_m(off_m)
        weight = 1 / (1 + (off_m / (_TOLERANCE * scatter_m)) ** 2) ** 2
        design = np.column_stack([direction, np.ones(len(off_m))])
        information = (design * weight[:, None]).T @ design
        step = np.linalg.solve(information, design.T @ (weight * off_m))
        x, y, radius = x + step[0], y + step[1], radius + step[2]
        if not radius_m / 2 < radius < 2 * radius_m:
            return None
        if np.abs(step).max() < _STEP_M:
            break
    count = float(weight.sum())
    if count < MIN_SECTORS:
        return None
    own_m = scatter_m * np.sqrt(np.linalg.inv(information)[2, 2] * count / (count - 3))
    missing = 1 - count / SECTORS
    return 2 * radius, 2 * float(np.hypot(own_m, UNSEEN_SHAPE_STD * missing * radius))


def _sectors(xy_m: Float, radius_m: float) -> tuple[Float, Float] | None:
    """Directions (S, 2) of the sectors with enough points, and how far outside these lie (S,)."""
    apart_m = np.linalg.norm(xy_m, axis=1)
    off_m = apart_m - radius_m
    scatter_m = _scatter_m(off_m)
    weight = 1 / (1 + (off_m / (_TOLERANCE * scatter_m)) ** 2) ** 2
    turn = (np.arctan2(xy_m[:, 1], xy_m[:, 0]) / (2 * np.pi) + 0.5) * SECTORS
    sector = np.minimum(turn.astype(np.intp), SECTORS - 1)
    total = np.bincount(sector, weight, SECTORS)
    kept = total >= MIN_SECTOR_POINTS
    if np.count_nonzero(kept) < MIN_SECTORS:
        return None
    mean_m = np.bincount(sector, weight * off_m, SECTORS)[kept] / total[kept]
    middle = ((np.flatnonzero(kept) + 0.5) / SECTORS - 0.5) * 2 * np.pi
    return np.stack([np.cos(middle), np.sin(middle)], -1), mean_m


def _scatter_m(off_m: Float) -> float:
    return max(MAD_TO_STD * float(np.median(np.abs(off_m))), LEAST_SCATTER_M)
