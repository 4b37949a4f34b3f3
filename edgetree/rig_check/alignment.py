"""The alignment of depth to colour: shift, size, turn, parallax and delay in one fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from basetree.arrays import Float
from calib import PinholeCamera
from edgetree.measure import Estimate
from edgetree.rig_check.checks import RigCheck, judged
from edgetree.rig_check.peak_fit import PeakFit, Profiles, fit_peak, search_peak
from edgetree.rig_check.silhouettes import Silhouettes, reach_px

GROUP: Final = "alignment of depth to colour"

# A shift by a fifth of a stem's width moves its diameter by 1 % (median) to 9 % (one in ten); the
# width is that of a stem of 0.2 m at 8 m. See docs/guides/check-rig.md.
_LIMIT_RAD: Final = 0.2 * 0.2 / 8
# A wrong baseline shifts a stem by the same share of its width at all distances: a fifth of 0.1 m.
_BASELINE_MM: Final = 20.0
# The shift of _LIMIT_RAD while the machine turns by 20 degrees per second.
_DELAY_LIMIT_MS: Final = _LIMIT_RAD / math.radians(20) * 1000
# What differs from drive to drive beyond the stated deviations (benchmarks/check_rig.py): shifts in
# px at a focal length of 349 px, shares, degrees, mm and ms.
_FOCAL_PX: Final = 349.0
_SYSTEMATIC: Final = {
    "x": 0.1,
    "y": 0.25,
    "size": 0.05,
    "turn": 0.03,
    "baseline": 2.0,
    "delay": 1.0,
}
_BLOCK_S: Final = 2.0
_MIN_BLOCKS, _MIN_SILHOUETTES = 5, 1000
# Gradient of the colour on the silhouettes, relative to that around them, below which there may be
# no common edges at all.
_MIN_CONTRAST: Final = 1.12
_SEARCH_SHARE, _SEARCH_STEP_PX = 0.75, 3.0
_SEARCH_S: Final = np.arange(-0.2, 0.201, 0.02)
_LONGER: Final = "drive longer, among stems within 8 m, by daylight"
# What to do if a check does not hold, and what makes its interval narrower.
_ADVICE: Final = (
    "calibrate the two cameras to each other again (guide: Use your own camera)",
    _LONGER,
)
_DELAY_ADVICE: Final = (
    "synchronise the cameras, or correct their time stamps",
    "drive longer, with turns",
)


@dataclass(frozen=True, eq=False)
class FrameSilhouettes:
    """The silhouettes of a frame.

    Attributes:
        time_s: Time stamp.
        silhouettes: The silhouettes, N.
        velocity: (N, 2) velocity of the picture there, px/s.
    """

    time_s: float
    silhouettes: Silhouettes
    velocity: Float


def alignment_checks(frames: Sequence[FrameSilhouettes], camera: PinholeCamera) -> list[RigCheck]:
    """Check shift, size, turn, parallax and delay of depth against colour.

    Args:
        frames: The frames with silhouettes.
        camera: Intrinsics of the colour.
    """
    fit = _fit(frames, camera)
    limit_px = _LIMIT_RAD * camera.fx
    at_border = limit_px / (camera.width / 2)
    px, degrees = camera.fx / _FOCAL_PX, math.degrees(1)
    # Name, unit of the parameter in the unit of the check, deviation, limit, unit of the check.
    rows = (
        ("shift to the right", 1.0, px * _SYSTEMATIC["x"], limit_px, "px"),
        ("shift downwards", 1.0, px * _SYSTEMATIC["y"], limit_px, "px"),
        ("size", 100.0, _SYSTEMATIC["size"], 100 * at_border, "%"),
        ("turn clockwise", degrees, _SYSTEMATIC["turn"], degrees * at_border, "°"),
        ("error of the baseline", 1000 / camera.fx, _SYSTEMATIC["baseline"], _BASELINE_MM, "mm"),
        ("delay of the depth", 1000.0, _SYSTEMATIC["delay"], _DELAY_LIMIT_MS, "ms"),
    )
    checks = []
    for column, (name, factor, systematic, limit, unit) in enumerate(rows):
        estimate: Estimate | str
        if isinstance(fit, str):
            estimate = fit
        else:
            std = math.hypot(float(fit.stds[column]) * factor, systematic)
            estimate = Estimate(float(fit.values[column]) * factor, std)
        advice = _DELAY_ADVICE if unit == "ms" else _ADVICE
        checks.append(judged(name, GROUP, estimate, limit, unit, *advice))
    return checks


def _fit(frames: Sequence[FrameSilhouettes], camera: PinholeCamera) -> PeakFit | str:
    """Fit all parameters, or say why that is not possible.

    The last parameter is the distance by which silhouettes lie outside of their objects on all
    sides, as those of stereo cameras do.
    """
    count = sum(len(frame.silhouettes) for frame in frames)
    if count < _MIN_SILHOUETTES:
        return f"{count} silhouettes in the depth: {_MIN_SILHOUETTES} are needed; {_LONGER}"
    blocks = [int(frame.time_s // _BLOCK_S) for frame in frames]
    if len(set(blocks)) < _MIN_BLOCKS:
        return f"too short: {_MIN_BLOCKS * _BLOCK_S:.0f} s of frames are needed"
    near = np.concatenate([1 / frame.silhouettes.depth_m for frame in frames])
    middle = float(np.median(near))
    profiles = Profiles(
        np.concatenate([frame.silhouettes.profile for frame in frames]),
        np.concatenate([_regressors(frame, camera, middle) for frame in frames]),
        np.repeat(blocks, [len(frame.silhouettes) for frame in frames]),
    )
    reach = _SEARCH_SHARE * reach_px(camera.width)
    shifts = np.arange(0, reach, _SEARCH_STEP_PX * camera.width / 640)
    shifts = np.concatenate([-shifts[:0:-1], shifts])
    grid = np.zeros((len(shifts), len(shifts), len(_SEARCH_S), 7))
    grid[..., 0], grid[..., 1] = shifts[:, None, None], shifts[:, None]
    grid[..., 5] = _SEARCH_S
    fit = fit_peak(profiles, search_peak(profiles, grid.reshape(-1, 7)))
    if fit.contrast < _MIN_CONTRAST:
        return (
            "the colour has no edges where depth jumps, within"
            f" {reach:.0f} px: either the picture is too dark, or the shift is larger"
        )
    return fit


def _regressors(frame: FrameSilhouettes, camera: PinholeCamera, middle: float) -> Float:
    """(N, 7) change of the distance from silhouette to colour edge, along the normal, px.

    Of a shift of depth in x and y (px), its size (share), its turn (rad, clockwise in the picture),
    the baseline (px m, from the nearness `middle` on), its delay (s), and a distance outwards (px).
    """
    seen = frame.silhouettes
    away = seen.xy_px - (camera.cx, camera.cy)
    turned = np.column_stack([-away[:, 1], away[:, 0]])
    return np.column_stack(
        [
            -seen.normal,
            -(seen.normal * away).sum(axis=1),
            -(seen.normal * turned).sum(axis=1),
            -seen.normal[:, 0] * (1 / seen.depth_m - middle),
            (seen.normal * frame.velocity).sum(axis=1),
            np.ones(len(seen)),
        ]
    )
