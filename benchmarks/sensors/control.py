"""Cylinders in front of the simulator's sensor models."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float32
from benchmarks.metres.stand import BREAST_HEIGHT_M, Stand, Stem
from benchmarks.sensors.views import View
from calib import PinholeCamera, project_points
from perceptree.simulator.sensors.depth import measure_depth
from perceptree.simulator.settings import DepthSettings

SIZES = ((1280, 720), (848, 480), (640, 480), (256, 192))
SENSORS = {
    "stereo": ("stereo", False),
    "stereo-2x2": ("stereo", True),
    "tof": ("tof", False),
    "tof-2x2": ("tof", True),
    "exact": None,
}
"""Kinds of the simulator's sensors, and whether each of their readings fills 2x2 px."""
_STEMS, _BEHIND = 3, 4
# Stems are at least so many px wide.
_MIN_PX = 8.0
_WALL_M = 14.0


def draw(rng: np.random.Generator, size: tuple[int, int], sensor: str) -> View:
    """Three cylinders on a slope, trees behind them, and in half of the scenes a forest edge."""
    width, height = size
    focal = width * rng.uniform(0.5, 0.75)
    camera = PinholeCamera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    frame = Stand(
        [_stem(rng, focal, number) for number in range(_STEMS)] + _behind(rng),
        camera,
        camera_height_m=rng.uniform(1.2, 2.2),
        pitch_deg=rng.uniform(-2, 8),
        roll_deg=rng.normal(0, 2),
        slope_deg=abs(rng.normal(0, 5)),
        uphill_deg=rng.uniform(0, 360),
        seed=int(rng.integers(1 << 30)),
    )
    depth_m = frame.depth_m
    if rng.random() < 0.5:
        depth_m = np.where((depth_m == 0) | (depth_m > _WALL_M), np.float32(_WALL_M), depth_m)
    return View(
        depth_m=_sensed(rng, depth_m, camera, sensor),
        camera=camera,
        up=frame.up,
        places_px=[
            project_points(camera, frame.axis_m(number, BREAST_HEIGHT_M)[None])[0]
            for number in frame.measured
        ],
        truths=[frame.truth(number) for number in frame.measured],
        outlines=frame.masks(),
    )


def _sensed(
    rng: np.random.Generator, depth_m: Float32, camera: PinholeCamera, sensor: str
) -> Float32:
    chosen = SENSORS[sensor]
    if chosen is None:
        return depth_m
    kind, half = chosen
    settings = DepthSettings(kinds={kind: 1.0}, half_resolution=half)
    return measure_depth(rng, settings, depth_m, camera).depth_m


def _stem(rng: np.random.Generator, focal: float, number: int) -> Stem:
    """A cylinder in its own third of the picture."""
    diameter_m = rng.uniform(0.13, 0.32)
    ahead_m = rng.uniform(2.2, max(2.4, min(6.5, diameter_m * focal / _MIN_PX)))
    return Stem(
        diameter_m=diameter_m,
        right_m=ahead_m * (0.4 * (number - 1) + rng.uniform(-0.12, 0.12)),
        ahead_m=ahead_m,
        lean_deg=abs(rng.normal(0, 3)),
        lean_towards_deg=rng.uniform(0, 360),
        taper=0.0,
        top_m=rng.uniform(6, 12),
    )


def _behind(rng: np.random.Generator) -> list[Stem]:
    ahead_m = rng.uniform(8, 16, _BEHIND)
    return [
        Stem(rng.uniform(0.1, 0.4), at * rng.uniform(-0.7, 0.7), at, top_m=12.0, measured=False)
        for at in ahead_m.tolist()
    ]
