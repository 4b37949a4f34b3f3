"""Standard deviations of the diameters at the sections."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.frame import DepthFrame
from edgetree.measure.observations import StemObservations
from edgetree.measure.stem_fit import Stems

__all__ = ["diameter_stds_m", "incomplete_stds"]

Float = NDArray[np.floating[Any]]

# Largest relative standard deviation for incomplete or contradictory observations.
_MAX_INCOMPLETE_STD = 0.45
# Share of these deviations where the caller gives the masks.
_GIVEN_MASK_DOUBT = 0.3


def diameter_stds_m(frame: DepthFrame, stems: Stems, incomplete_std: Float) -> Float:
    """(T,) standard deviations of the diameters.

    First-order error propagation through the diameter 2 d sin(delta): its relative change is
    that of the distance d, plus that of delta times cot(delta). Since d depends on delta too,
    the relative change of d per radian of delta is added to cot(delta). Focal length, stem
    shape and incomplete observations add independent relative errors.

    Args:
        frame: camera and settings.
        stems: T fitted stems.
        incomplete_std: (T,) see `incomplete_stds`.
    """
    half = stems.sections.half_rad
    edges = stems.half_std_rad * np.abs(1 / np.tan(half) + stems.distance_change_per_rad)
    distance = stems.distance_std_m / stems.distance_m
    focal = np.full_like(half, frame.camera.focal_std_px / frame.camera.fx)
    shape = np.full_like(half, frame.settings.out_of_round_std)
    parts = [edges, distance, focal, shape, incomplete_std]
    return np.asarray(2 * stems.radius_m * np.linalg.norm(parts, axis=0))


def incomplete_stds(frame: DepthFrame, observed: StemObservations, stems: Stems) -> Float:
    """(T,) relative standard deviations for incomplete or contradictory observations.

    See `MeasureSettings.outline_doubt` and `readings_doubt`.
    """
    settings, edges = frame.settings, observed.edges
    shown = edges.valid.mean(2).min(0)
    outline = 0.0 if observed.outline is None else settings.outline_doubt
    unread = 1 - stems.used / observed.readings.depth_m.shape[1]
    parts = (outline * (1 - shown) ** 4, settings.readings_doubt * unread**2)
    share = _GIVEN_MASK_DOUBT if frame.masks_given else 1.0
    return np.asarray(np.minimum(share * np.linalg.norm(parts, axis=0), _MAX_INCOMPLETE_STD))
