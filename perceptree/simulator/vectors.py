"""Vectors in world axes: x east, y north, z up."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.floating[Any]]

UP = np.array([0.0, 0.0, 1.0])


def unit(vectors: Float) -> Float:
    """(..., 3) vectors scaled to length one; a zero vector stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-9))
