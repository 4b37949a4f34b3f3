"""Plausibility checks of depth maps."""

import numpy as np
import pytest
from numpy.typing import NDArray

from calib import DepthError, check_depth, mask_by_confidence

SCENE = np.random.default_rng(0).uniform(1.5, 12, (120, 160)).astype(np.float32)


def holes(share: float) -> NDArray[np.float32]:
    missing = np.random.default_rng(1).random(SCENE.shape) < share
    return np.where(missing, 0, SCENE)


def saturated() -> NDArray[np.float32]:
    return np.where(np.random.default_rng(1).random(SCENE.shape) < 0.7, np.float32(65.535), SCENE)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_a_plausible_map_gives_a_report(dtype: type[np.floating]) -> None:
    report = check_depth(holes(0.25).astype(dtype))
    assert report
    assert report.valid_share == pytest.approx(0.75, abs=0.02)
    assert 1.4 < report.nearest_m < 1.6
    assert report.median_m == pytest.approx(6.75, abs=0.2)
    assert 11.9 < report.farthest_m < 12.1


def test_values_that_are_not_finite_are_missing() -> None:
    depth_m = SCENE.copy()
    depth_m[::2], depth_m[:30] = np.nan, np.inf
    report = check_depth(depth_m)
    assert report
    assert report.valid_share == pytest.approx(0.375)
    assert report.farthest_m < 12.1


@pytest.mark.parametrize(
    ("depth", "reason"),
    [
        (np.zeros_like(SCENE), "no pixel has depth: expected readings"),
        (np.full_like(SCENE, np.nan), "no pixel has depth: expected readings"),
        (-SCENE, "no pixel has depth: expected readings"),
        (np.full_like(SCENE, 4), "every reading is 4 m: expected different depths"),
        (SCENE * 1000, "look like millimetres, to be read with a scale of 0.001"),
        (SCENE / 1000, "look like metres that were read as millimetres"),
        (saturated(), "70% of the readings are the largest, 65.535 m: saturated"),
        (SCENE.astype(np.uint16), "the depth map is uint16: expected metres as float32"),
        (SCENE[0], "the depth map has shape (160,): expected (H, W)"),
        (SCENE[..., None], "the depth map has shape (120, 160, 1): expected (H, W)"),
        (SCENE[:0], "the depth map has shape (0, 160): expected (H, W)"),
    ],
)
def test_implausible_maps_give_a_reason(depth: np.ndarray, reason: str) -> None:
    failure = check_depth(depth)
    assert not failure
    assert reason in failure.reason


def test_the_minimum_share_can_be_set() -> None:
    assert check_depth(holes(0.97), min_share=0.01)
    assert "expected 90.00%" in check_depth(holes(0.25), min_share=0.9).reason
    assert not check_depth(holes(0.25), min_share=0.9)
    assert not check_depth(np.zeros_like(SCENE), min_share=0.0)


@pytest.mark.parametrize("steps_m", [0.0, 0.001])
def test_a_sapling_before_the_sky_is_depth_enough(steps_m: float) -> None:
    depth_m = np.zeros((1250, 2000), np.float32)  # of which every 50th column is sampled
    depth_m[300:900, 1010:1016] = 8.0
    depth_m[300:600, 1010:1016] += np.float32(steps_m)
    report = check_depth(depth_m)
    assert report
    assert report.valid_share == pytest.approx(600 * 6 / depth_m.size)


def test_a_large_map_is_subsampled() -> None:
    report = check_depth(np.tile(holes(0.5), (9, 9)))
    assert report
    assert report.valid_share == pytest.approx(0.5, abs=0.03)


def test_readings_with_low_confidence_are_removed() -> None:
    depth_m = np.array([[1.0, 2.0, 3.0]], np.float32)
    confidence = np.array([[10, 50, 90]], np.uint8)
    masked = mask_by_confidence(depth_m, confidence, 50)
    assert masked.dtype == np.float32
    assert masked.tolist() == [[0.0, 2.0, 3.0]]
    assert mask_by_confidence(depth_m, np.array([[np.nan, 0, 100]]), 50).tolist() == [[0, 0, 3]]
    with pytest.raises(DepthError, match=r"shape \(1, 2\): expected the depth map's \(1, 3\)"):
        mask_by_confidence(depth_m, confidence[:, :2], 50)
