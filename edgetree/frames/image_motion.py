"""How the picture moves from one frame to the next, as a similarity."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from basetree.arrays import Float, UInt8

_MOST_POINTS: Final = 200
_MIN_POINTS: Final = 20
_WIDTH_PX: Final = 480
_MOST_SCALE: Final = 4.0  # from frame to frame: beyond, it is no motion of the camera


def small_grey(picture: UInt8) -> UInt8:
    """A picture as `similarity` compares it.

    Args:
        picture: (H, W, 3) uint8 BGR.

    Returns:
        (h, 480) uint8.
    """
    size = (_WIDTH_PX, max(round(picture.shape[0] * _WIDTH_PX / picture.shape[1]), 1))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), np.uint8)


def similarity(before: UInt8, now: UInt8) -> Float | None:
    """The motion of most of the picture, from corners that are followed between two frames.

    A similarity is fitted to the corners' motion (Lucas and Kanade's tracker, RANSAC).

    Args:
        before, now: (h, 480) uint8, from `small_grey`.

    Returns:
        (2, 3) matrix from places in `now` to those in `before`, in widths of the picture; None if
        the motion cannot be found.
    """
    if before.shape != now.shape:
        return None
    corners = cv2.goodFeaturesToTrack(now, _MOST_POINTS, 0.01, 8)
    if corners is None or len(corners) < _MIN_POINTS:
        return None
    moved, found, _ = cv2.calcOpticalFlowPyrLK(now, before, corners, corners.copy(), maxLevel=4)
    kept = found.ravel() == 1
    if kept.sum() < _MIN_POINTS:
        return None
    matrix, inliers = cv2.estimateAffinePartial2D(
        corners[kept], moved[kept], ransacReprojThreshold=2.0
    )
    if matrix is None or inliers.sum() < _MIN_POINTS:
        return None
    scale = np.hypot(*matrix[0, :2])  # a similarity has the same in both directions
    if not 1 / _MOST_SCALE < scale < _MOST_SCALE:
        return None
    matrix[:, 2] /= _WIDTH_PX
    return np.asarray(matrix, np.float64)
