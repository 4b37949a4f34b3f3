"""Fit the shift between silhouettes and the colour's edges as a linear function of some regressors.

The sum over all silhouettes of the colour's gradient at their shifted places is made as large as
possible (an M-estimate, as in Huber 1981, Robust Statistics). The gradient is smoothed with a
normal distribution, first with a wide one to find the peak and then with a narrow one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from basetree.arrays import Float, Index

_SIGMAS_PX: Final = (4.0, 3.0, 2.0, 1.5)
_STEPS: Final = 30
_DAMPING: Final = (1e-3, 1e6)
_CONVERGED: Final = 1e-4
_RESAMPLES: Final = 400
_SEARCH_MOST: Final = 8000
# Mean gradient of a picture of one colour is not quite 0 because of rounding (1e-5 at most).
_NO_GRADIENT: Final = 1e-3


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profiles of the colour's gradient with what their shift may depend on.

    Attributes:
        gradient: (N, 2 R + 1) gradients from -R to R px along the normal.
        regressors: (N, P) what is multiplied with the parameters to give the shift in px.
        block: (N,) number of the stretch of time that each is from; these are resampled.
    """

    gradient: Float
    regressors: Float
    block: Index


@dataclass(frozen=True, eq=False)
class PeakFit:
    """The fitted parameters.

    Attributes:
        values: (P,) parameters.
        stds: (P,) their standard deviations, from resampled blocks; infinite where the data do not
            tell the parameter.
        contrast: Gradient at the shifted silhouettes, relative to that around them; 0 if there is
            no gradient beyond rounding.
    """

    values: Float
    stds: Float
    contrast: float


def search_peak(profiles: Profiles, grid: Float) -> Float:
    """Choose the best of some parameters.

    Args:
        profiles: The profiles.
        grid: (M, P) parameters to try.
    """
    some = slice(None, None, max(1, len(profiles.gradient) // _SEARCH_MOST))
    smooth = _smoothed(profiles.gradient[some], _SIGMAS_PX[0])[0]
    rows = np.arange(len(smooth))
    reach = smooth.shape[1] // 2
    mean = smooth.mean(axis=1)
    totals = []
    for values in grid:
        at = np.rint(profiles.regressors[some] @ values).astype(np.intp) + reach
        inside = (at >= 0) & (at < smooth.shape[1])
        at = np.clip(at, 0, smooth.shape[1] - 1)
        totals.append(np.where(inside, smooth[rows, at], mean).sum())
    return np.asarray(grid[int(np.argmax(totals))])


def fit_peak(profiles: Profiles, start: Float) -> PeakFit:
    """Fit the parameters from a start that is right to about 5 px.

    Columns of regressors that are zero leave their parameter at its start.
    """
    values = np.array(start, np.float64)
    used = np.flatnonzero(np.abs(profiles.regressors).max(axis=0) > 0)
    rows = profiles.regressors[:, used]
    for sigma in _SIGMAS_PX:
        smooth = _smoothed(profiles.gradient, sigma)
        values[used] = _climb(smooth, rows, values[used])
    gradient, hessian = _block_derivatives(smooth, rows, values[used], profiles.block)
    stds = np.full(len(values), np.inf)
    stds[used] = _block_stds(gradient, hessian)
    level, _, _ = _at(smooth, rows @ values[used])
    around = float(profiles.gradient.mean())
    contrast = float(level.mean()) / around if around > _NO_GRADIENT else 0.0
    return PeakFit(values, stds, contrast)


def _smoothed(gradient: Float, sigma: float) -> tuple[Float, Float, Float]:
    """The profiles smoothed with a normal distribution, and their two derivatives."""
    t = np.arange(-int(3 * sigma + 1), int(3 * sigma + 1) + 1)
    normal = np.exp(-0.5 * (t / sigma) ** 2)
    normal /= normal.sum()
    kernels = normal, -t / sigma**2 * normal, (t**2 / sigma**4 - 1 / sigma**2) * normal
    width = gradient.shape[1]
    padded = np.pad(gradient, ((0, 0), (len(t) // 2, len(t) // 2)), mode="edge")
    # Matrices of the convolutions: (width + padding, width).
    out = []
    for kernel in kernels:
        matrix = np.zeros((padded.shape[1], width), np.float32)
        for column in range(width):
            matrix[column : column + len(t), column] = kernel[::-1]
        out.append(padded @ matrix)
    return out[0], out[1], out[2]


def _at(smooth: tuple[Float, Float, Float], shift: Float) -> tuple[Float, Float, Float]:
    """(N,) values of the profiles (N, 2 R + 1) at the shifts (N,), and two derivatives.

    A Taylor series around the nearest sample: the derivatives are those of the value.
    """
    width = smooth[0].shape[1]
    reach = width // 2
    nearest = np.clip(np.rint(shift), -reach, reach)
    rest = np.clip(shift - nearest, -0.5, 0.5)
    place = np.arange(len(shift)) * width + (nearest + reach).astype(np.intp)
    value, slope, bend = (each.ravel()[place].astype(np.float64) for each in smooth)
    return value + rest * (slope + rest * bend / 2), slope + rest * bend, bend


def _climb(smooth: tuple[Float, Float, Float], rows: Float, values: Float) -> Float:
    """Newton's method with Levenberg's damping, which makes the sum larger in every step."""
    scale = np.sqrt((rows**2).mean(axis=0))
    damping = _DAMPING[0]
    height, slope, bend = _at(smooth, rows @ values)
    for _ in range(_STEPS):
        gradient = rows.T @ slope / scale
        matrix = -(rows * bend[:, None]).T @ rows / np.outer(scale, scale)
        unit = float(np.abs(bend).sum())
        while damping < _DAMPING[1]:
            damped = matrix + damping * unit * np.eye(len(scale))
            if np.linalg.eigvalsh(damped).min() > 0:
                step = np.linalg.solve(damped, gradient)
                new = _at(smooth, rows @ (values + step / scale))
                if new[0].sum() >= height.sum():
                    break
            damping *= 10
        else:
            return values
        values, damping = values + step / scale, damping / 10
        height, slope, bend = new
        if np.abs(step).max() < _CONVERGED:
            break
    return values


def _block_derivatives(
    smooth: tuple[Float, Float, Float], rows: Float, values: Float, block: Index
) -> tuple[Float, Float]:
    """Gradients (B, P) and negative Hessians (B, P, P) of the sums over each block."""
    _, slope, bend = _at(smooth, rows @ values)
    gradient, hessian = [], []
    for number in np.unique(block):
        chosen = block == number
        gradient.append(rows[chosen].T @ slope[chosen])
        hessian.append((rows[chosen] * -bend[chosen, None]).T @ rows[chosen])
    return np.array(gradient), np.array(hessian)


def _block_stds(gradient: Float, hessian: Float) -> Float:
    """(P,) deviations of one Newton step each, over resampled blocks (bootstrap)."""
    count, parameters = gradient.shape
    total = hessian.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diag(total), 1e-12))
    if count < 2 or np.linalg.eigvalsh(total / np.outer(scale, scale)).min() < 1e-3:
        return np.full(parameters, np.inf)
    # The Hessian of all: one of few blocks need not be invertible.
    return resampled_stds(gradient, total)


def resampled_stds(gradient: Float, hessian: Float) -> Float:
    """(P,) standard deviations of fitted parameters, by the bootstrap.

    Args:
        gradient: (B, P) of each block of data at the solution; their sum is 0.
        hessian: (P, P) of all data.
    """
    count = len(gradient)
    times = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), _RESAMPLES)
    steps = np.linalg.solve(hessian, (times @ gradient).T).T
    return np.asarray(steps.std(axis=0) * math.sqrt(count / (count - 1)))
