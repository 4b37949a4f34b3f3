"""Where a tree is cut: just above its root flare and what stands at its foot.

The rule of ``cut_rule`` "visible", for every tree alike: the stem is cut at the lowest height at
which its root collar swells the stem by at most 8 % of its radius, and 3 cm above the highest
stone or stump that stands within 15 cm of the bark, but at least 5 and at most 50 cm above the
ground on the uphill side. The diameter points lie 10 cm above the cut.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.scene.stem import Stem

Float = NDArray[np.floating[Any]]

LOWEST_M, HIGHEST_M = 0.05, 0.50
DIAMETER_ABOVE_CUT_M = 0.10
_SWELLING = 0.08
_CLEARANCE_M = 0.03
_REACH_M = 0.15
_STEP_M = 0.01


def cut_height_m(stem: Stem, uphill_m: float, obstacles_m: Iterable[float] = ()) -> float:
    """Height of the cut above the ground on the uphill side.

    ``uphill_m`` is how much higher that ground is than the stem's foot; ``obstacles_m`` are the
    heights of what stands at the foot, above the same ground.
    """
    levels = np.arange(LOWEST_M, HIGHEST_M + _STEP_M / 2, _STEP_M)
    slim = levels[_swelling(stem, levels + uphill_m) <= _SWELLING]
    lowest = float(slim[0]) if len(slim) else HIGHEST_M
    needed = [height + _CLEARANCE_M for height in obstacles_m]
    return round(float(np.clip(max([lowest, *needed]), LOWEST_M, HIGHEST_M)), 4)


def _swelling(stem: Stem, height_m: Float) -> Float:
    """(heights,) how much the root collar adds to the mean radius, as a share of it."""
    total = np.zeros_like(height_m)
    for _, swelling, narrowness, reach_m in stem.roots:
        around = 2 * np.pi * np.arange(64) / 64
        mean = float(np.exp(narrowness * (np.cos(around) - 1)).mean())
        total += swelling * mean * 2 / (1 + np.exp(np.minimum(height_m / reach_m, 60.0)))
    return total


def stands_at(
    foot_m: Float, radius_m: float, places_m: Float, reaches_m: Float
) -> NDArray[np.bool_]:
    """(n,) whether things at ``places_m`` (n, 2), so wide, stand at a stem's foot (2,)."""
    gap_m = np.hypot(*(places_m - foot_m).T) - radius_m - reaches_m
    return np.asarray(gap_m < _REACH_M)
