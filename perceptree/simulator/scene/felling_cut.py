"""Height of the felling cut: just above the root flare and above obstacles at the foot.

This is `cut_rule` "visible". The cut is at the lowest height where the root collar widens the
stem by at most 8 % of its radius, and at least 3 cm above every stone or stump within 15 cm of the
bark. It is limited to 5 to 50 cm above the ground on the uphill side. The diameter keypoints are
10 cm above the cut.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from basetree.arrays import Bool, Float
from perceptree.simulator.scene.stem import Stem

LOWEST_M, HIGHEST_M = 0.05, 0.50
DIAMETER_ABOVE_CUT_M = 0.10
_SWELLING = 0.08  # largest widening by the root collar, as a fraction of the radius
_CLEARANCE_M = 0.03  # height of the cut above obstacles
_REACH_M = 0.15  # distance from the bark within which obstacles count
_STEP_M = 0.01  # step of the search


def cut_height_m(stem: Stem, uphill_m: float, obstacles_m: Iterable[float] = ()) -> float:
    """Compute the height of the cut.

    Args:
        stem: The stem.
        uphill_m: Height of the ground on the uphill side above the stem's foot, m.
        obstacles_m: Heights of obstacles at the foot above the ground on the uphill side, m.

    Returns:
        Height above the ground on the uphill side, m.
    """
    levels = np.arange(LOWEST_M, HIGHEST_M + _STEP_M / 2, _STEP_M)
    slim = levels[_swelling(stem, levels + uphill_m) <= _SWELLING]
    lowest = float(slim[0]) if len(slim) else HIGHEST_M
    needed = [height + _CLEARANCE_M for height in obstacles_m]
    return round(float(np.clip(max([lowest, *needed]), LOWEST_M, HIGHEST_M)), 4)


def _swelling(stem: Stem, height_m: Float) -> Float:
    """(heights,) what the root collar adds to the mean radius, as a fraction of it."""
    total = np.zeros_like(height_m)
    for _, swelling, narrowness, reach_m in stem.roots:
        around = 2 * np.pi * np.arange(64) / 64
        mean = float(np.exp(narrowness * (np.cos(around) - 1)).mean())
        total += swelling * mean * 2 / (1 + np.exp(np.minimum(height_m / reach_m, 60.0)))
    return total


def is_near_foot(foot_m: Float, radius_m: float, places_m: Float, reaches_m: Float) -> Bool:
    """Test which obstacles are close to a stem's bark.

    Args:
        foot_m: (2,) position of the stem, m.
        radius_m: Radius of the stem, m.
        places_m: (n, 2) positions of the obstacles, m.
        reaches_m: (n,) radii of the obstacles, m.

    Returns:
        (n,) bool, true within 15 cm of the bark.
    """
    gap_m = np.hypot(*(places_m - foot_m).T) - radius_m - reaches_m
    return np.asarray(gap_m < _REACH_M)
