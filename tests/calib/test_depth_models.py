"""Depth from disparity and from ranges."""

import math
from dataclasses import replace

import numpy as np
import pytest

from calib import (
    CameraError,
    DepthError,
    PinholeCamera,
    depth_to_disparity,
    depth_to_points,
    depth_to_range,
    disparity_to_depth,
    range_to_depth,
)

CAMERA = PinholeCamera(64, 48, 40.0, 41.0, 31.0, 24.0, (-0.2, 0.05, 1e-3, 0.0))
FISHEYE = replace(CAMERA, distortion=(0.0, 0.01, 0.0, 0.0), distortion_model="fisheye")


def test_a_disparity_becomes_depth() -> None:
    depth_m = disparity_to_depth([[70.0, 35.0, 0.0, -3.0, math.nan, math.inf]], 700.0, 0.12)
    assert depth_m.dtype == np.float32
    np.testing.assert_allclose(depth_m, [[1.2, 2.4, 0, 0, 0, 0]], rtol=1e-6)
    back = depth_to_disparity(depth_m, 700.0, 0.12)
    np.testing.assert_allclose(back, [[70.0, 35.0, 0, 0, 0, 0]], rtol=1e-6)


@pytest.mark.parametrize(("fx_px", "baseline_m"), [(0.0, 0.1), (700.0, -0.1), (math.nan, 0.1)])
def test_a_pair_without_width_is_refused(fx_px: float, baseline_m: float) -> None:
    with pytest.raises(DepthError, match="expected a positive number"):
        disparity_to_depth([[1.0]], fx_px, baseline_m)


@pytest.mark.parametrize("camera", [CAMERA, FISHEYE, replace(CAMERA, distortion=())])
def test_ranges_are_the_distances_of_the_points(camera: PinholeCamera) -> None:
    depth_m = np.random.default_rng(0).uniform(1, 9, (48, 64)).astype(np.float32)
    depth_m[3, 4] = 0
    ranges = depth_to_range(depth_m, camera)
    points = depth_to_points(camera, depth_m)
    np.testing.assert_allclose(ranges, np.linalg.norm(points, axis=-1), rtol=1e-6)
    np.testing.assert_allclose(range_to_depth(ranges, camera), depth_m, rtol=1e-6)
    with pytest.raises(CameraError, match="the depth map is 6x4 px"):
        range_to_depth(np.ones((4, 6)), camera)
