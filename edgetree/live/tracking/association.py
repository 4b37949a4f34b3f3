"""Which measured stem is which followed one."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Bool, Float, Index

__all__ = ["chi_squares", "match_greedily", "quadratic"]


def quadratic(offset: Float, covariance: Float) -> Float:
    """(...) chi-squares of (..., 2) offsets with (..., 2, 2) covariances."""
    a, b, d = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    x, y = offset[..., 0], offset[..., 1]
    return np.asarray((d * x**2 - 2 * b * x * y + a * y**2) / determinants(covariance))


def determinants(matrices: Float) -> Float:
    """(...) determinants of (..., 2, 2) matrices."""
    return np.asarray(
        matrices[..., 0, 0] * matrices[..., 1, 1] - matrices[..., 0, 1] * matrices[..., 1, 0]
    )


def chi_squares(
    lines: Float, line_covariances: Float, reference_m: Float, points: Float, covariances: Float
) -> tuple[Float, Float]:
    """Chi-squares between followed and measured stems, at the heights of the measured ones.

    Args:
        lines: (T, 4) followed lines at their heights of reference.
        line_covariances: (T, 4, 4).
        reference_m: (T,) heights of reference.
        points: (M, 3) measured points in the map.
        covariances: (M, 2, 2) of their x and y, with the error of the camera's place.

    Returns:
        (T, M) chi-squares, and (T, M) by how much the uncertainty of the followed stem lowers the
        probability density of the match, as a chi-square: the logarithm of the ratio of the
        determinants of both covariances together and of the measured one.
    """
    rise = points[:, 2] - reference_m[:, None]
    at = lines[:, None, :2] + rise[..., None] * lines[:, None, 2:]
    place, cross, slope = (
        line_covariances[:, :2, :2],
        line_covariances[:, :2, 2:] + line_covariances[:, 2:, :2],
        line_covariances[:, 2:, 2:],
    )
    rise = rise[..., None, None]
    total = place[:, None] + rise * cross[:, None] + rise**2 * slope[:, None] + covariances
    vague = np.log(determinants(total) / determinants(covariances))
    return quadratic(at - points[:, :2], total), vague


def match_greedily(cost: Float, allowed: Bool) -> tuple[Index, Index]:
    """Match rows and columns one to one, the lowest cost first.

    Stems stand further apart than a gate is wide, so that few have a choice. For those, an optimal
    assignment may give up the best match for the sake of a sum, which is wrong where a stem is
    hidden and another one is new.

    Args:
        cost: (T, M).
        allowed: (T, M) pairs that may match.

    Returns:
        Rows and columns of the pairs, by row.
    """
    candidates = np.argwhere(allowed)
    order = np.argsort(cost[allowed], kind="stable")
    rows: dict[int, int] = {}
    columns: set[int] = set()
    for row, column in candidates[order].tolist():
        if row not in rows and column not in columns:
            rows[row] = column
            columns.add(column)
    pairs = np.array(sorted(rows.items()), np.intp).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
