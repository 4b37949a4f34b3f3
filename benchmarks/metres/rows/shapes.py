"""Stems of unusual shape: oval, leaning far, forked, and two in one mask."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.metres.caster import Cone
from benchmarks.metres.rows.clean import Readings, stand, stem
from benchmarks.metres.rows.in_front import measured
from benchmarks.metres.sensors import stereo_noise


def oval(rng: np.random.Generator) -> Readings:
    """Sections whose axes differ by 10 %, seen from any side."""
    frame = stand(rng, [stem(rng, oval=1.1, oval_turn_deg=rng.uniform(0, 180))])
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    return measured(frame, rng, frame.masks())


def very_oval(rng: np.random.Generator) -> Readings:
    """Axes that differ by 30 %, as at some butts."""
    frame = stand(rng, [stem(rng, oval=1.3, oval_turn_deg=rng.uniform(0, 180))])
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    return measured(frame, rng, frame.masks())


def leaning(rng: np.random.Generator) -> Readings:
    """Thin stems that lean 30 to 48 degrees towards the camera."""
    tree = stem(
        rng,
        diameter_m=rng.uniform(0.07, 0.16),
        lean_deg=rng.uniform(30, 48),
        lean_towards_deg=rng.uniform(240, 300),
        top_m=rng.uniform(3, 5),
        ahead_m=rng.uniform(5, 8),
        right_m=rng.uniform(-1, 1),
    )
    frame = stand(rng, [tree])
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    return measured(frame, rng, frame.masks())


def fork(rng: np.random.Generator) -> Readings:
    """A second stem that parts from the first at 0.6 to 2 m, in the same mask."""
    tree = stem(rng)
    frame = stand(rng, [tree])
    start_m = frame.to_camera.T @ frame.axis_m(0, rng.uniform(0.6, 2.0))
    tilt, towards = np.radians(rng.uniform(8, 25)), rng.uniform(0, 2 * np.pi)
    along = np.array(
        [np.sin(tilt) * np.cos(towards), -np.cos(tilt), np.sin(tilt) * np.sin(towards)]
    )
    radius_m = tree.diameter_m / 2 * rng.uniform(0.5, 0.95)
    frame.things = [Cone(start_m, along, rng.uniform(2, 5), radius_m, 0.005, owner=1)]
    frame.render()
    masks = frame.masks()
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    return measured(frame, rng, masks)


def behind(rng: np.random.Generator) -> Readings:
    """A second stem half behind the first in one given mask, no keypoints."""
    tree = stem(rng, lean_deg=abs(rng.normal(0, 2)))
    ahead_m = tree.ahead_m * rng.uniform(1.05, 1.6)
    beside_m = rng.uniform(0.35, 0.95) * tree.diameter_m * rng.choice([-1, 1])
    second = stem(
        rng,
        ahead_m=ahead_m,
        right_m=(tree.right_m + beside_m) * ahead_m / tree.ahead_m,
        diameter_m=tree.diameter_m * rng.uniform(0.7, 1.5),
        lean_deg=abs(rng.normal(0, 2)),
    )
    frame = stand(rng, [tree, replace(second, measured=False)])
    masks = [frame.owner > 0]
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    return frame.readings(frame.detections(keypoints=False, masks=masks), given_masks=masks)


ROWS = {
    "oval": oval,
    "very-oval": very_oval,
    "leaning": leaning,
    "fork": fork,
    "behind": behind,
}
