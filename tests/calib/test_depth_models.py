"""Conversions of disparity and range to depth, and noise models."""

import math
from dataclasses import replace

import numpy as np
import pytest

from calib import (
    CameraError,
    DepthError,
    PinholeCamera,
    StereoNoise,
    TofNoise,
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
def test_invalid_stereo_parameters_are_rejected(fx_px: float, baseline_m: float) -> None:
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


def test_stereo_noise_grows_with_the_square_of_the_depth() -> None:
    noise = StereoNoise(baseline_m=0.12, fx_px=700.0, disparity_std_px=0.1)
    np.testing.assert_allclose(noise.std_m([0.0, 4.0, 8.0]), [0, 0.019047619, 0.076190476])
    disparity = depth_to_disparity([[8.0]], 700.0, 0.12)
    shifted = disparity_to_depth(disparity - 0.1, 700.0, 0.12)
    assert shifted.item() - 8 == pytest.approx(noise.std_m(8.0), rel=0.02)


def test_time_of_flight_noise_grows_with_the_depth() -> None:
    np.testing.assert_allclose(TofNoise(0.005, 0.002).std_m([0.0, 1.0, 5.0]), [0, 0.007, 0.015])


@pytest.mark.parametrize("noise", [StereoNoise(0.12, 700.0, 0.2), TofNoise(0.01, 0.004)])
def test_samples_have_the_models_standard_deviation(noise: StereoNoise | TofNoise) -> None:
    depth_m = np.full((200, 200), 6.0, np.float32)
    depth_m[:, :50] = 0
    samples = noise.sample(depth_m, np.random.default_rng(5))
    assert samples.dtype == np.float32
    assert not samples[:, :50].any()
    assert samples[:, 50:].std() == pytest.approx(noise.std_m(6.0), rel=0.02)
    assert samples[:, 50:].mean() == pytest.approx(6.0, abs=0.002)
    np.testing.assert_array_equal(samples, noise.sample(depth_m, np.random.default_rng(5)))


def test_a_reading_is_never_negative() -> None:
    samples = TofNoise(5.0, 0.0).sample(np.ones((50, 50)), np.random.default_rng(0))
    assert samples.min() == 0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((0.0, 700.0, 0.1), "baseline_m is 0.0: expected a positive number"),
        ((0.1, math.inf, 0.1), "fx_px is inf: expected a positive number"),
        ((0.1, 700.0, -1.0), "disparity_std_px is -1.0: expected a positive number"),
    ],
)
def test_invalid_noise_models_are_rejected(values: tuple[float, ...], message: str) -> None:
    with pytest.raises(DepthError) as caught:
        StereoNoise(*values)
    assert str(caught.value) == message
    with pytest.raises(DepthError, match=r"per_m is -0\.1: expected 0 or more"):
        TofNoise(0.0, -0.1)
