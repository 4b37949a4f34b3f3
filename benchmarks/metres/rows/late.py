"""Depth of another moment, while the machine moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.metres.rows.clean import Readings, stand, stem
from benchmarks.metres.sensors import stereo_noise
from benchmarks.metres.stand import Stand


def depth_of(frame: Stand, right_m: float, ahead_m: float) -> Stand:
    """The frame with its stems elsewhere, on the same ground, as another moment saw them."""
    moved = [
        replace(each, right_m=each.right_m + right_m, ahead_m=each.ahead_m + ahead_m)
        for each in frame.stems
    ]
    return replace(frame, stems=moved)


def _measured(rng: np.random.Generator, right_m: float, ahead_m: float) -> Readings:
    count = int(rng.integers(1, 5))
    stems = [
        stem(rng, right_m=1.4 * (number - (count - 1) / 2) + rng.normal(0, 0.2))
        for number in range(count)
    ]
    frame = stand(rng, stems, bumps_std_m=rng.uniform(0.005, 0.03))
    masks = frame.masks()
    frame.depth_m = stereo_noise(depth_of(frame, right_m, ahead_m).depth_m, rng)
    if min(mask.sum() for mask in masks) < 300:
        return []
    given = masks if rng.random() < 0.5 else None
    return frame.readings(frame.detections(rng, masks=masks), given_masks=given)


def late_ahead(rng: np.random.Generator) -> Readings:
    """The machine drove straight ahead since the depth was taken."""
    return _measured(rng, 0.0, rng.uniform(0.05, 0.8))


def late_aside(rng: np.random.Generator) -> Readings:
    """It turned a little too, which moves the depth sideways."""
    return _measured(rng, rng.uniform(-0.15, 0.15), rng.uniform(0.05, 0.6))


def late_back(rng: np.random.Generator) -> Readings:
    """It drove back since the depth was taken."""
    return _measured(rng, rng.uniform(-0.05, 0.05), -rng.uniform(0.05, 0.6))


ROWS = {"late-ahead": late_ahead, "late-aside": late_aside, "late-back": late_back}
