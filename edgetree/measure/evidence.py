"""What a measurement is based on: sources, visible parts and warnings."""

from __future__ import annotations

import math

import numpy as np

from edgetree.measure.estimates import Evidence, Failure
from edgetree.measure.ground import BaseGround
from edgetree.measure.observations import StemObservations
from edgetree.measure.stem_fit import Stems

__all__ = ["gather_evidence"]

_SOURCES = ("keypoints", "mask", "depth")
# A source is named in `Evidence.method` from this weight on.
_MIN_WEIGHT = 0.02
# Keypoints and mask disagree if their diameters differ by more than this many standard deviations.
_MAX_DISAGREEMENT_STDS = 3.0


def gather_evidence(
    index: int,
    stems: Stems,
    observed: StemObservations,
    ground: BaseGround | Failure,
    warnings: tuple[str, ...],
) -> Evidence:
    """Describe what the measurement of one stem is based on.

    Args:
        index: number of the stem.
        stems: the fitted stems.
        observed: the observations that they are fitted to.
        ground: ground at the stem.
        warnings: warnings about other values of the stem, which come first.
    """
    distance_m = float(stems.distance_m[index])
    known = {
        name: (float(half.rad[index]), float(half.std_rad[index]))
        for name, half in zip(_SOURCES, stems.sources, strict=True)
        if np.isfinite(half.std_rad[index])
    }
    diameters = {name: 2 * distance_m * math.sin(rad) for name, (rad, _) in known.items()}
    stds = {name: 2 * distance_m * math.cos(rad) * std for name, (rad, std) in known.items()}
    weights = zip(_SOURCES, stems.weights[index], strict=True)
    outline = observed.outline
    return Evidence(
        method=" + ".join(name for name, weight in weights if weight > _MIN_WEIGHT),
        source_diameters_m=diameters,
        source_std_m=stds,
        arc_deg=float(np.degrees(stems.arc_rad[index])),
        valid_depth_share=float(observed.valid_depth_fraction[index]),
        visible_share=None if outline is None else float(outline.visible_fraction[index]),
        ground=ground.description() if isinstance(ground, BaseGround) else ground.reason,
        warnings=warnings + _disagreement(diameters, stds),
    )


def _disagreement(diameters: dict[str, float], stds: dict[str, float]) -> tuple[str, ...]:
    """A warning if keypoints and mask tell different diameters."""
    if not {"keypoints", "mask"} <= diameters.keys():
        return ()
    keypoints_m, mask_m = diameters["keypoints"], diameters["mask"]
    std_m = math.hypot(stds["keypoints"], stds["mask"])
    if abs(keypoints_m - mask_m) <= _MAX_DISAGREEMENT_STDS * std_m:
        return ()
    return (f"keypoints and mask disagree: {keypoints_m:.2f} m and {mask_m:.2f} m",)
