"""The given vertical against the axes of the stems, which are vertical on average."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from basetree.arrays import Float, Index
from basetree.counts import counted
from edgetree.measure import Estimate
from edgetree.rig_check.checks import RigCheck, judged
from edgetree.rig_check.stem_sightings import Sighting, level_axes

GROUP: Final = "vertical"

_LIMIT_DEG: Final = 4.0
_MIN_STEMS: Final = 10
# Measured axes lean away from the camera by more than the true ones: stems are thinner further up,
# so the side that the camera sees recedes. Degrees ahead and to the left (benchmarks/check_rig.py).
_BIAS_DEG: Final = (1.0, 0.0)
# Stems of a stand lean together because of wind, light and slope.
_COMMON_STD_DEG: Final = 1.0
# Axes that are less certain than this tell little.
_MOST_STD_DEG: Final = 6.0
# Views of a stem share its bends and their errors: deviation that more views do not make smaller.
_SHARED_STD_DEG: Final = 1.0
_RESAMPLES: Final = 400


def vertical_checks(sightings: list[Sighting]) -> list[RigCheck]:
    """Check the vertical's angles ahead and to the side.

    Args:
        sightings: Stems of all frames; those of frames without a given vertical are left out.
    """
    known = [each for each in sightings if each.frame.up_camera is not None]
    names = ("stems lean away from the camera", "stems lean to the left")
    estimates: list[Estimate | str] = ["the source gives no vertical: pass --up"] * 2
    if known or not sightings:
        estimates = [_mean_lean(known, column) for column in (0, 1)]
    return [
        judged(
            name,
            GROUP,
            estimate,
            _LIMIT_DEG,
            "°",
            remedy="check how the IMU and the camera are mounted to each other, or --up",
            need="drive past more stems",
        )
        for name, estimate in zip(names, estimates, strict=True)
    ]


def _mean_lean(sightings: list[Sighting], column: int) -> Estimate | str:
    """Median over the stems of their leans in degrees, ahead (0) or to the left (1)."""
    lean: Float = np.zeros(0)
    if sightings:
        ups = np.array([each.frame.up_camera for each in sightings])
        _, direction, _, covariance = level_axes(sightings, ups)
        std = np.degrees(np.sqrt(covariance[:, column, column]))
        lean = np.degrees(np.arctan2(direction[:, column], direction[:, 2]))
        numbers = np.array([each.stem for each in sightings])
        lean = _per_stem(numbers, lean, std)
    if len(lean) < _MIN_STEMS:
        return (
            f"{counted(len(lean), 'stem')} with a sure axis: {_MIN_STEMS} are needed; drive"
            " past more stems"
        )
    generator = np.random.default_rng(0)
    drawn = lean[generator.integers(0, len(lean), (_RESAMPLES, len(lean)))]
    std_deg = math.hypot(float(np.median(drawn, axis=1).std()), _COMMON_STD_DEG)
    return Estimate(float(np.median(lean)) - _BIAS_DEG[column], std_deg)


def _per_stem(stem: Index, lean: Float, std: Float) -> Float:
    """Weighted mean leans of the stems, of those whose lean is sure."""
    weight = 1 / (std**2 + _SHARED_STD_DEG**2)
    _, place = np.unique(stem, return_inverse=True)
    total = np.bincount(place, weight)
    mean = np.bincount(place, weight * lean) / total
    return np.asarray(mean[total > 1 / _MOST_STD_DEG**2])
