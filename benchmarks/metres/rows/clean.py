"""Scenes without faults: what every change must leave as it is."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from benchmarks.metres.sensors import stereo_noise
from benchmarks.metres.stand import Stand, Stem
from calib import PinholeCamera
from edgetree.measure import TreeMeasurement

Readings = Iterable[tuple[TreeMeasurement, dict[str, Any]]]


def camera(rng: np.random.Generator, width: int = 848) -> PinholeCamera:
    """A pinhole camera of usual field of view."""
    height = width * 9 // 16 // 2 * 2
    focal = width * rng.uniform(0.5, 0.75)
    centre = np.array([width, height]) / 2 + rng.uniform(-6, 6, 2)
    return PinholeCamera(width, height, focal, focal, *centre.tolist())


def stem(rng: np.random.Generator, **changes: Any) -> Stem:
    """A stem as they stand in a forest."""
    ahead = rng.uniform(3.5, 9.0)
    cut = rng.uniform(0.1, 0.3)
    values = {
        "diameter_m": rng.uniform(0.12, 0.5),
        "right_m": rng.uniform(-0.2, 0.2) * ahead,
        "ahead_m": ahead,
        "lean_deg": abs(rng.normal(0, 4)),
        "lean_towards_deg": rng.uniform(0, 360),
        "cut_m": cut,
        "section_m": cut,
        "top_m": rng.uniform(5, 12),
        "taper": rng.uniform(0.005, 0.015),
    }
    return Stem(**{**values, **changes})


def stand(rng: np.random.Generator, stems: list[Stem], **changes: Any) -> Stand:
    """A frame of stems by a camera on a machine."""
    values = {
        "camera": camera(rng),
        "camera_height_m": rng.uniform(1.5, 2.6),
        "pitch_deg": rng.uniform(2, 12),
        "roll_deg": rng.normal(0, 2),
        "slope_deg": abs(rng.normal(0, 7)),
        "uphill_deg": rng.uniform(0, 360),
        "seed": int(rng.integers(1 << 30)),
    }
    return Stand(stems, **{**values, **changes})


def exact(rng: np.random.Generator) -> Readings:
    """Exact depth, masks and keypoints."""
    return stand(rng, [stem(rng)]).readings()


def noisy(rng: np.random.Generator) -> Readings:
    """Stereo noise, and errors of keypoints as large as stated."""
    frame = stand(rng, [stem(rng)])
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    return frame.readings(frame.detections(rng))


def mask_alone(rng: np.random.Generator) -> Readings:
    """A given mask, no keypoints."""
    frame = stand(rng, [stem(rng)])
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    return frame.readings(frame.detections(keypoints=False), given_masks=frame.masks())


ROWS = {"exact": exact, "noisy": noisy, "mask-alone": mask_alone}
