"""Stems whose shape or direction is far from the usual."""

import numpy as np
import pytest

from calib import PinholeCamera

CAMERA = PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)


@pytest.mark.parametrize("seed", range(1000, 1006))
@pytest.mark.parametrize("towards_deg", [-90.0, 90.0])
def test_thin_stems_that_lean_far_along_the_view(scene, pole, seed, towards_deg):
    rng = np.random.default_rng(seed)
    stem = pole(
        rng.uniform(0.08, 0.16),
        rng.uniform(-1.0, 1.0),
        rng.uniform(4.5, 8.0),
        rng.uniform(34.0, 50.0),
        towards_deg,
        top_m=rng.uniform(2.2, 3.0),
    )
    stand = scene(stem, camera=CAMERA, camera_height_m=rng.uniform(1.5, 2.2))
    noise = 0.002 * rng.normal(size=stand.depth_m.shape) * stand.depth_m**2
    stand.depth_m = np.where(stand.depth_m > 0, stand.depth_m + noise, 0.0)
    tree = stand.measure(masks=stand.masks())
    cut = stand.foot(stem) + stem.cut_m * stand.along(stem)
    for value, true, allowed in (
        (tree.inclination_deg, stem.lean_deg, 4.0),
        (tree.distance_m, np.linalg.norm(cut), 0.15),
    ):
        assert abs(value.value - true) < min(allowed, 3 * value.std)
