"""Fit planes to points of ground and plants: trial planes, probabilities and weighted fits."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from calib.directions import cross

_TRIALS = 32
_SCORED_POINTS = 60  # of each set, at least, for a trial plane
# Trial planes go through the lowest points of this many cells in each horizontal direction.
_CELLS = 8
# Returns above a plane may be plants. Returns below it are errors, so they cost a plane more.
# Largest costs, in the units of a squared distance over its variance.
_COST_ABOVE, _COST_BELOW = 4.0, 12.0
# The mixture of ground, plants and errors that weighs the points of the final fit: the share of
# errors among the points that are no ground; the height of plants, in tolerances.
_ERROR_SHARE, _PLANT_TOLERANCES = 0.003, 12.0
# The tolerance is this many standard deviations of the ground's unevenness.
_TOLERANCE_STDS = 3.0
# Share of a point's `departure_m` that counts when ground is told from plants. With all of it, low
# plants away from the middle pass for ground and lift the plane.
_CLASS_DEPARTURE_SHARE = 0.15


class GroundCloud(NamedTuple):
    """T sets of N points to which planes are fitted.

    Attributes:
        points: (T, N, 3) points in metres, 0 where not usable. The third axis is the vertical.
        by_axis: (T, 3, N) the same, with the values of one coordinate side by side.
        usable: (T, N) the points to use.
        noise: (T, N) standard deviations of the depth, relative to it.
        departure_m: (T, N) standard deviations by which the ground leaves the plane.
        tolerance_m: Largest distance of ground points from their plane, without errors of depth.
    """

    points: Float
    by_axis: Float
    usable: Bool
    noise: Float
    departure_m: Float
    tolerance_m: float

    def best_trial(self, least_cosine: float) -> tuple[Float, Float, Bool]:
        """Find the best of many planes through three random low points of each set.

        Returns:
            (T, 3) normals, (T,) offsets, and (T,) whether any plane was flat enough.
        """
        low, count = self._lowest()
        each = np.arange(len(low))
        picked = low[each[:, None], (_draws() * count[:, None]).astype(np.intp)]
        corners = self.by_axis[each[:, None, None], [[0], [1], [2]], picked[:, None]]
        a, b, c = corners.reshape(len(low), 3, 3, _TRIALS).transpose(2, 1, 0, 3)
        normals = cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=0)
        normals /= np.where(length > 1e-9, length, np.inf) * np.where(normals[2] < 0, -1.0, 1.0)
        flat = normals[2] >= least_cosine
        through = (normals * a).sum(0)
        normals = np.ascontiguousarray(normals.transpose(1, 2, 0))
        scored = slice(None, None, max(self.points.shape[1] // _SCORED_POINTS, 1))
        along = np.matmul(normals, self.points[:, scored].transpose(0, 2, 1))
        height = along - through[..., None]
        noise, departure_m = self.noise[:, None, scored], self.departure_m[:, None, scored]
        variance = self._variance(along, noise) + (_CLASS_DEPARTURE_SHARE * departure_m) ** 2
        largest = np.where(height > 0, _COST_ABOVE, _COST_BELOW)
        cost = np.minimum(height**2 / variance, largest)
        cost = np.matmul(cost, self.usable[:, scored, None].astype(np.float64))[..., 0]
        total = np.where(flat, cost, np.inf)
        best = total.argmin(1)
        return normals[each, best], -through[each, best], np.asarray(flat.any(axis=1))

    def _lowest(self) -> tuple[Index, Index]:
        """Indices (T, C) of the lowest point in each horizontal cell, and their numbers (T,)."""
        level, usable = self.by_axis[:, :2], self.usable[:, None]
        first = np.where(usable, level, np.inf).min(2, keepdims=True)
        last = np.where(usable, level, -np.inf).max(2, keepdims=True)
        width = np.maximum(last - first, 1e-9)
        cells = np.clip((level - first) / width * _CELLS, 0, _CELLS - 1).astype(np.intp)
        cell = cells[:, 0] + _CELLS * cells[:, 1]
        order = np.argsort(-self.by_axis[:, 2], axis=1)
        lowest = np.full((len(cell), _CELLS**2 + 1), -1)
        # Of several values for one place the last one stays, which is that of the lowest point.
        place = np.where(self.usable, cell, _CELLS**2)
        lowest[np.arange(len(cell))[:, None], np.take_along_axis(place, order, 1)] = order
        lowest = lowest[:, :-1]
        filled = (lowest >= 0).sum(1)
        return np.take_along_axis(lowest, np.argsort(lowest < 0, axis=1, kind="stable"), 1), filled

    def _variance(self, along: Float, noise: Float) -> Float:
        """Variance of a ground point's height: of unevenness, and of the depth times its slope.

        Args:
            along: Normal times point; divided by the depth, the height's change per depth.
            noise: Standard deviation of the depth, relative to it.
        """
        return (self.tolerance_m / _TOLERANCE_STDS) ** 2 + (along * noise) ** 2

    def probabilities(
        self, normal: Float, offset: Float, ground_share: Float
    ) -> tuple[Float, Float, Float]:
        """(T, N) probabilities that points are ground, and plants, and variances for the fit.

        Args:
            normal: (T, 3) normals of the planes.
            offset: (T,) their offsets.
            ground_share: (T,) shares of ground among the points.
        """
        along = np.matmul(self.points, normal[..., None])[..., 0]
        height = along + offset[:, None]
        own = self._variance(along, self.noise)
        variance = own + (_CLASS_DEPARTURE_SHARE * self.departure_m) ** 2
        std = np.sqrt(variance)
        share, plants_m = ground_share[:, None], _PLANT_TOLERANCES * self.tolerance_m
        ground = share * np.exp(-(height**2) / (2 * variance)) / (np.sqrt(2 * np.pi) * std)
        plants = (1 - share) * (1 - _ERROR_SHARE) / plants_m * (height > 0)
        errors = (1 - share) * _ERROR_SHARE / plants_m + 1e-12
        total = ground + plants + errors
        fit_variance = own + self.departure_m**2
        return self.usable * ground / total, self.usable * plants / total, fit_variance

    def regression(self, weight: Float, normal: Float, offset: Float) -> tuple[Float, Float]:
        """Fit the planes' heights along the vertical by weighted least squares.

        Args:
            weight: (T, N) weights of the points.
            normal: (T, 3) normals that stay where the points fix no plane.
            offset: (T,) offsets that stay there.
        """
        total = np.maximum(weight.sum(1), 1e-300)
        centre = np.matmul(self.by_axis, weight[..., None])[..., 0] / total[:, None]
        apart = self.by_axis - centre[..., None]
        products = np.matmul(weight[:, None] * apart[:, :2], apart.transpose(0, 2, 1))
        xx, xy, xz = products[:, 0].T
        _, yy, yz = products[:, 1].T
        determinant = xx * yy - xy**2
        fixed = determinant > 1e-9 * (xx + yy) ** 2
        divisor = np.where(fixed, determinant, 1.0)
        slopes = (yy * xz - xy * yz) / divisor, (xx * yz - xy * xz) / divisor
        tilted = np.stack([-slopes[0], -slopes[1], np.ones(len(xx))], -1)
        tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
        new = np.where(fixed[:, None], tilted, normal)
        return new, np.where(fixed, -(tilted * centre).sum(1), offset)


@cache
def _draws() -> Float:
    """(3 * trials,) random numbers from 0 to 1 that pick the corners of trial planes."""
    return np.random.default_rng(0).random(3 * _TRIALS)
