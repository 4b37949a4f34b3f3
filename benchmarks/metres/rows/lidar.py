"""Stems by a laser scanner beside a camera: widths from the picture, distances from the beams."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.metres.rows.clean import Readings, stand, stem
from benchmarks.metres.scanner import SCANNERS, scan
from benchmarks.metres.stand import Stand, Stem
from calib.clouds import depth_of_beams
from edgetree.measure import EXACT_RIG

DISTANCES_M = {"near": (3.0, 8.0), "far": (8.0, 16.0)}
_OTHERS = 4


def scene(rng: np.random.Generator, ahead_m: tuple[float, float]) -> Stand:
    """A stem among others, of which some stand behind it."""
    ahead = rng.uniform(*ahead_m)
    first = stem(rng, ahead_m=ahead, right_m=rng.uniform(-0.25, 0.25) * ahead)
    others: list[Stem] = []
    for _ in range(_OTHERS):
        behind = ahead + rng.uniform(1.0, 12.0)
        right = first.right_m / ahead * behind + rng.uniform(-0.35, 0.35) * behind
        others.append(stem(rng, ahead_m=behind, right_m=right, measured=False))
    return stand(rng, [first, *others])


def lidar(rng: np.random.Generator, rings: int, ahead_m: tuple[float, float]) -> Readings:
    """Errors of keypoints as large as stated, a calibration with errors, and a known camera."""
    frame = scene(rng, ahead_m)
    scanned = scan(frame, SCANNERS[rings], rng)
    frame.depth_m = depth_of_beams(scanned.cloud, frame.camera, scanned.to_camera).depth_m
    return frame.readings(frame.detections(rng), sparse=True, rig_uncertainty=EXACT_RIG)


ROWS = {
    f"lidar-{rings}-{name}": partial(lidar, rings=rings, ahead_m=ahead_m)
    for rings in SCANNERS
    for name, ahead_m in DISTANCES_M.items()
}
