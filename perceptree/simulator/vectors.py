"""Vectors in world axes (x east, y north, z up)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float

UP = np.array([0.0, 0.0, 1.0])


def heading(angle_rad: ArrayLike) -> Float:
    """(..., 2) unit vectors at angles (...) from the first axis."""
    return np.stack([np.cos(angle_rad), np.sin(angle_rad)], -1)


def unit(vectors: Float) -> Float:
    """Normalise vectors (..., 3); a zero vector remains zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-9))
