"""Boxes in image pixels: how far two of them overlap."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float64


def box_iou(first_px: ArrayLike, second_px: ArrayLike) -> Float64:
    """Intersection over union of every pair of boxes.

    Args:
        first_px: (N, 4) x0, y0, x1, y1.
        second_px: (M, 4) likewise.

    Returns:
        (N, M) in [0, 1]; 0 where both boxes of a pair are empty.

    Examples:
        >>> box_iou([[0, 0, 10, 10]], [[5, 0, 15, 10], [20, 0, 30, 10]]).round(2)
        array([[0.33, 0.  ]])
    """
    first = np.asarray(first_px, np.float64).reshape(-1, 1, 4)
    second = np.asarray(second_px, np.float64).reshape(1, -1, 4)
    low = np.maximum(first[..., :2], second[..., :2])
    high = np.minimum(first[..., 2:], second[..., 2:])
    shared = _area(low, high)
    union = _area(first[..., :2], first[..., 2:]) + _area(second[..., :2], second[..., 2:]) - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)


def _area(low: Float64, high: Float64) -> Float64:
    """Area between corners (..., 2); 0 where they are in the wrong order."""
    sides = np.clip(high - low, 0, None)
    return np.asarray(sides[..., 0] * sides[..., 1])
