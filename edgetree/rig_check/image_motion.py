"""The velocity of the picture, from one frame to the next."""

from __future__ import annotations

from typing import Final

import numpy as np

from basetree.arrays import Float, UInt8
from edgetree.frames.image_motion import similarity, small_grey

_LONGEST_S: Final = 0.4


def image_velocity(before: UInt8, now: UInt8, step_s: float, xy_px: Float) -> Float:
    """Velocity of the picture at some places: that of most of it, as `similarity` finds it.

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
    matrix = similarity(small_grey(before), small_grey(now))
    if matrix is None:
        return none
    xy = xy_px / now.shape[1]
    return np.asarray((xy - (xy @ matrix[:, :2].T + matrix[:, 2])) * now.shape[1] / step_s)
