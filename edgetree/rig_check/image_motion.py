"""How the picture moves from one frame to the next, as a similarity."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from basetree.arrays import Float, UInt8

_MOST_POINTS: Final = 200
_MIN_POINTS: Final = 20
_WIDTH_PX: Final = 480
_LONGEST_S: Final = 0.4


def image_velocity(before: UInt8, now: UInt8, step_s: float, xy_px: Float) -> Float:
    """Velocity of the picture at some places, from corners that are followed between two frames.

    A similarity is fitted to the corners' motion (Lucas and Kanade's tracker, RANSAC), so the
    velocity is that of most of the picture.

    Args:
        before, now: (H, W, 3) uint8 pictures.
        step_s: Time between them, s.
        xy_px: (N, 2) places in `now`.

    Returns:
        (N, 2) px per second; zero if the motion cannot be found.
    """
    none = np.zeros_like(xy_px)
    if not 0 < step_s < _LONGEST_S or before.shape != now.shape:
        return none
    scale = _WIDTH_PX / now.shape[1]
    size = (_WIDTH_PX, round(now.shape[0] * scale))
    first, second = (
        cv2.cvtColor(cv2.resize(each, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
        for each in (before, now)
    )
    corners = cv2.goodFeaturesToTrack(second, _MOST_POINTS, 0.01, 8)
    if corners is None or len(corners) < _MIN_POINTS:
        return none
    moved, found, _ = cv2.calcOpticalFlowPyrLK(second, first, corners, corners.copy(), maxLevel=4)
    kept = found.ravel() == 1
    if kept.sum() < _MIN_POINTS:
        return none
    matrix, inliers = cv2.estimateAffinePartial2D(
        corners[kept], moved[kept], ransacReprojThreshold=2.0
    )
    if matrix is None or inliers.sum() < _MIN_POINTS:
        return none
    xy = xy_px * scale
    return np.asarray((xy - (xy @ matrix[:, :2].T + matrix[:, 2])) / scale / step_s)
