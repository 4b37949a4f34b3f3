"""``perceptree`` with a renderer that makes noise, for fast tests of datasets.

This is a separate program, because the worker processes import the main module. The package is
imported after the renderer is replaced, and so without it.
"""

from __future__ import annotations

import os
import sys
import time
import types
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from perceptree.simulator import SimulatorSettings
    from perceptree.simulator.dataset.scene_job import SceneJob
    from perceptree.simulator.labelling.frame import LabelledFrame


PACE = "FAKE_FRAME_SECONDS"
DYING_SCENE = "FAKE_DYING_SCENE"


def make_assets(photographs: object = None) -> str:
    """There are no assets to make."""
    return "assets"


def simulate_frames(
    settings: SimulatorSettings, seed: int, views: int, assets: str
) -> Iterator[LabelledFrame]:
    """Fake frames, determined by the scene's seed and their number."""
    if os.environ.get(DYING_SCENE) == str(seed):
        os.kill(os.getpid(), 9)
    for number in range(views):
        time.sleep(float(os.environ.get(PACE, "0")))
        yield fake_frame(settings, seed, number)


def draw_here(jobs: list[SceneJob], workers: int) -> Iterator[int]:
    """Replacement of ``pool.draw_scenes`` that uses only this process."""
    from perceptree.simulator.dataset.scene_job import draw_scene

    for job in jobs:
        yield draw_scene(job, None)


def fake_frame(settings: SimulatorSettings, seed: int, number: int) -> LabelledFrame:
    """A frame of noise, a depth plane, and one or two posts."""
    from perceptree.simulator.labelling.frame import LabelledFrame, SceneRecord
    from perceptree.simulator.settings import GROUNDS, TIMES, WEATHERS

    rng = np.random.default_rng([seed, number])
    camera = settings.camera.intrinsics
    shape = camera.height, camera.width
    exact = np.zeros(shape, np.float32)
    exact[10:] = np.linspace(2, 20, camera.height - 10, dtype=np.float32)[:, None]
    measured = np.where(rng.random(shape) < 0.1, 0, exact).astype(np.float32)
    scene = SceneRecord(
        seed,
        GROUNDS[seed % 4],
        12.5,
        432.1,
        "regular",
        WEATHERS[seed % 6],
        0.25,
        TIMES[seed % 4],
        bool(seed % 2),
    )
    pose = SimpleNamespace(carrier="mast", height_m=2.5, pitch_deg=-10.0, roll_deg=1.0)
    return LabelledFrame(
        rng.integers(0, 255, (*shape, 3), np.uint8),
        measured,
        exact,
        [fake_label(shape, rng, number) for number in range(1 + number % 2)],
        SimpleNamespace(intrinsics=camera, up=np.array([0.0, -1.0, 0.0]), pose=pose),
        scene,
        {"kind": "tof", "baseline_m": 0.0, "noise": 0.00025, "range_m": 9.0},
    )


def fake_label(shape: tuple[int, int], rng: np.random.Generator, number: int) -> SimpleNamespace:
    """A post with five keypoints, the last one outside the frame."""
    left = 10 + 50 * number
    mask = np.zeros(shape, bool)
    mask[8:60, left : left + 12] = True
    keypoints = np.array(
        [[left + 6, 58, 2], [left, 55, 2], [left + 12, 55, 2], [left + 6, 46, 1], [0, 0, 0]], float
    )
    diameter_m = float(rng.uniform(0.1, 0.5))
    return SimpleNamespace(
        mask=mask,
        box_px=np.array([left, 8, left + 12, 60], float),
        keypoints=keypoints,
        distance_m=5.0,
        diameter_m=diameter_m,
        diameter_height_m=0.3,
        diameter_breast_m=0.8 * diameter_m,
        cut_height_m=0.2,
        inclination_deg=3.0,
        position_camera_m=np.array([0.5, 1.0, 4.9]),
        position_world_m=np.array([3.0, 4.0, 0.1]),
        visible_fraction=float(rng.uniform(0.1, 1.0)),
        species="beech",
        model="beech_smooth",
    )


def small_settings(views: int = 2) -> SimulatorSettings:
    """Settings for frames of 128x72."""
    from perceptree.simulator.settings import SimulatorSettings, ideal_camera

    settings = SimulatorSettings(views_per_scene=views)
    return replace(settings, camera=replace(settings.camera, intrinsics=ideal_camera(128, 72)))


def contents(directory: Path) -> dict[str, bytes]:
    """Name and bytes of every file of a dataset."""
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    return {str(path.relative_to(directory)): path.read_bytes() for path in files}


fake = types.ModuleType("perceptree.simulator.dataset.frames")
fake.make_assets, fake.simulate_frames, fake.Assets = make_assets, simulate_frames, str

if __name__ in ("__main__", "__mp_main__"):
    sys.modules[fake.__name__] = fake

if __name__ == "__main__":
    from perceptree.cli import main

    main()
