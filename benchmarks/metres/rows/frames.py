"""What a whole frame is in doubt about: its ground, its vertical, and the rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.metres.caster import smooth_noise
from benchmarks.metres.rows.clean import Readings, stand, stem
from benchmarks.metres.rows.in_front import measured
from benchmarks.metres.sensors import stereo_noise
from benchmarks.metres.stand import Stand
from edgetree.measure import MeasureSettings, measure_trees


def _covered(rng: np.random.Generator) -> tuple[Stand, float]:
    """A stem in plants or snow with an even top, and their height."""
    cover_m = rng.uniform(0.12, 0.45)
    cut_m = cover_m * rng.choice([0.4, 0.7, 1.1]) + rng.uniform(0.02, 0.2)
    top_m = cover_m + smooth_noise(rng, 256, rng.uniform(0.004, 0.02))
    patches = smooth_noise(rng, 256, 1.0)
    covered = patches < np.quantile(patches, rng.uniform(0.88, 1.0))
    frame = stand(
        rng,
        [stem(rng, cut_m=cut_m, section_m=cut_m)],
        plants_m=np.where(covered, np.maximum(top_m, 0), 0),
        plant_cell_m=rng.uniform(0.02, 0.08),
    )
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    return frame, float(cover_m)


def even_cover(rng: np.random.Generator) -> Readings:
    """Plants or snow 12 to 45 cm high with an even top, on 88 to 100 % of the ground."""
    frame, _ = _covered(rng)
    return measured(frame, rng, frame.masks())


def stated_cover(rng: np.random.Generator) -> Readings:
    """The same with its height stated, as a person measures it."""
    frame, cover_m = _covered(rng)
    stated_m = max(cover_m + rng.normal(0, 0.04), 0.02)
    settings = MeasureSettings(ground_cover_m=stated_m, ground_cover_std_m=0.05)
    return frame.readings(frame.detections(rng), settings=settings)


def no_vertical(rng: np.random.Generator) -> Readings:
    """One to five stems without a given vertical, some of them with a common lean."""
    common_deg, towards_deg = rng.choice([0, 0, 5]), rng.uniform(0, 360)
    count = int(rng.integers(1, 6))
    stems = [
        stem(
            rng,
            right_m=2.0 * (number - (count - 1) / 2),
            lean_deg=abs(common_deg + rng.normal(0, 3)),
            lean_towards_deg=towards_deg if common_deg else rng.uniform(0, 360),
        )
        for number in range(count)
    ]
    frame = stand(rng, stems, slope_deg=rng.choice([0, 5, 12, 25]))
    masks = frame.masks()
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    if min(mask.sum() for mask in masks) < 300:
        return []
    return frame.readings(frame.detections(rng, masks=masks), vertical=False)


def rig_off(rng: np.random.Generator) -> Readings:
    """A depth scale 1 % off, a principal point 20 px off, or a vertical 5 degrees off."""
    frame = stand(rng, [stem(rng)])
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    trees, camera, up = frame.detections(rng), frame.camera, frame.up
    fault = rng.integers(3)
    if fault == 0:
        frame.depth_m = (frame.depth_m * (1 + rng.choice([-0.01, 0.01]))).astype(np.float32)
    elif fault == 1:
        camera = replace(camera, cx=camera.cx + rng.choice([-20, 20]))
    else:
        turn = np.cross(rng.normal(0, 1, 3), up)
        up = up + np.radians(5) * turn / np.linalg.norm(turn)
    found = measure_trees(trees, frame.depth_m, camera, up_camera=up)
    return [(tree, frame.truth(n)) for n, tree in zip(frame.measured, found, strict=True)]


ROWS = {
    "even-cover": even_cover,
    "stated-cover": stated_cover,
    "no-vertical": no_vertical,
    "rig-off": rig_off,
}
