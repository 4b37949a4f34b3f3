"""The colour across silhouettes: an edge makes a peak, and noise makes none."""

from __future__ import annotations

import numpy as np
import pytest
from rig_drives import panning_drive

from edgetree.rig_check.silhouettes import find_silhouettes


def test_noise_makes_no_peak_at_the_silhouettes() -> None:
    generator = np.random.default_rng(0)
    profiles = []
    for frame in panning_drive(6)[::5]:
        assert frame.depth_m is not None
        noise = generator.integers(20, 120, (*frame.depth_m.shape, 3)).astype(np.uint8)
        profiles.append(find_silhouettes(noise, frame.depth_m).profile)
    mean = np.concatenate(profiles).mean(axis=0)
    assert mean[23:26].mean() == pytest.approx(mean.mean(), rel=0.02)


def test_normals_point_from_near_to_far() -> None:
    depth_m = np.full((360, 640), 9, np.float32)
    depth_m[:, 300:340] = 4
    image = np.full((360, 640, 3), 60, np.uint8)
    image[:, 300:340] = 160
    found = find_silhouettes(image, depth_m)
    right = found.normal[:, 0] > 0
    np.testing.assert_allclose(found.xy_px[right, 0], 339.5)
    np.testing.assert_allclose(found.xy_px[~right, 0], 299.5)
    np.testing.assert_allclose(found.depth_m, 4, rtol=1e-5)
    middle = (found.profile @ np.arange(-24, 25)) / found.profile.sum(axis=1)
    np.testing.assert_allclose(middle, 0, atol=0.05)
