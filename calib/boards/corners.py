"""Points of boards: regular grids, and corners refined in an image."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from basetree.arrays import Float, UInt8
from basetree.settings import limits
from basetree.settings.metadata import Metadata

LEAST_POINTS: Final = 8
WINDOW_SHARE: Final = 0.35
"""Half the side of the window in which a corner is refined, of the distance to the next edge."""
_MIN_WINDOW_PX, _MAX_WINDOW_PX = 2, 30
_REFINE_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
_MAX_COUNT, _MAX_LENGTH_M = 100, 2.0

LENGTH: Final = limits(
    over=0,
    most=_MAX_LENGTH_M,
    expected=f"metres, more than 0 and up to {_MAX_LENGTH_M:g}",
    style="g",
)


def counts(what: str) -> Metadata:
    """Return the limits of a number of things in a row."""
    return limits(3, _MAX_COUNT, expected=f"3 to {_MAX_COUNT} {what}")


def grid(columns: int, rows: int) -> Float:
    """Return (rows * columns, 3) integer grid points, row by row, z = 0."""
    y, x = np.mgrid[0:rows, 0:columns].reshape(2, -1)
    return np.stack([x, y, np.zeros_like(x)], -1).astype(np.float64)


def min_spacing_px(grid_px: Float) -> float:
    """Return the smallest distance between neighbours of a (rows, columns, 2) grid."""
    along = np.linalg.norm(np.diff(grid_px, axis=1), axis=-1)
    across = np.linalg.norm(np.diff(grid_px, axis=0), axis=-1)
    return float(min(along.min(), across.min()))


def refine_corners(grey: UInt8, corners_px: Float, window_px: float) -> Float:
    """Refine corners, in OpenCV's px, to sub-pixel accuracy on the image gradients."""
    half = int(np.clip(window_px, _MIN_WINDOW_PX, _MAX_WINDOW_PX))
    corners = np.array(corners_px, np.float32).reshape(-1, 1, 2)  # OpenCV changes it in place
    refined = cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), _REFINE_CRITERIA)
    return np.asarray(refined, np.float64).reshape(-1, 2)
