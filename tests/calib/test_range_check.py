"""The ground tells depth from range along the rays."""

from __future__ import annotations

import numpy as np
import pytest

import calib
from calib.depth.range_check import RangeExponent, kind_words, range_exponent

CAMERA = calib.PinholeCamera(640, 480, fx=400.0, fy=400.0, cx=319.5, cy=239.5)
UP = np.array([0.05, -0.96, -0.27])
UP = UP / np.linalg.norm(UP)


def ground(seed: int = 1000, camera: calib.PinholeCamera = CAMERA) -> np.ndarray:
    """(H, W) depth of uneven ground 2 m below the camera, with two stems before it."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = calib.pixels_to_rays(camera, np.stack([columns, rows], -1) + 0.5)
    falling = -(rays @ UP)
    depth_m = np.where(falling > 0.13, 2.0 / np.maximum(falling, 0.13), 0.0)
    depth_m = depth_m * (1 + 0.01 * rng.standard_normal(depth_m.shape))
    for left in (150, 420):
        depth_m[:350, left : left + 60] = 4.0
    return depth_m.astype(np.float32)


def told(depth_m: np.ndarray, kind: calib.DepthKind, camera: calib.PinholeCamera = CAMERA) -> str:
    found = range_exponent(depth_m, camera, UP, kind)
    return kind_words([found] if found else [], kind) or ""


@pytest.mark.parametrize("seed", [1000, 1001, 1002])
def test_each_kind_is_right_as_itself_and_told_as_the_other(seed: int) -> None:
    depth_m = ground(seed)
    range_m = calib.depth_to_range(depth_m, CAMERA)
    assert told(depth_m, "depth") == ""
    assert "give --depth-kind range" in told(range_m, "depth")
    assert told(calib.range_to_depth(range_m, CAMERA), "range") == ""
    assert "give --depth-kind depth" in told(calib.range_to_depth(depth_m, CAMERA), "range")


def test_the_exponent_has_its_error() -> None:
    found = range_exponent(calib.depth_to_range(ground(), CAMERA), CAMERA, UP)
    assert isinstance(found, RangeExponent)
    assert abs(found.value - 1) < 2 * found.std < 0.5


def test_a_bent_lens_is_no_range() -> None:
    camera = calib.PinholeCamera(640, 480, 400.0, 400.0, 319.5, 239.5, (-0.2, 0.05, 0.0, 0.0))
    assert told(ground(camera=camera), "depth", camera) == ""


@pytest.mark.parametrize(
    ("depth_m", "words"),
    [
        (np.zeros((480, 640), np.float32), "no ground"),
        (np.full((480, 640), 1.0, np.float32), "no ground"),
        (np.where(abs(np.mgrid[:480, :640][1] - 320) < 10, ground(), 0), "no ground"),
    ],
)
def test_without_ground_nothing_is_told(depth_m: np.ndarray, words: str) -> None:
    found = range_exponent(depth_m, CAMERA, UP)
    assert not found
    assert words in found.reason


def test_a_narrow_lens_tells_nothing() -> None:
    camera = calib.PinholeCamera(640, 480, fx=1400.0, fy=1400.0, cx=319.5, cy=239.5)
    found = range_exponent(ground(camera=camera), camera, UP)
    assert not found
    assert "too near the middle of the picture" in found.reason


def test_one_doubtful_frame_says_nothing_and_many_do() -> None:
    doubtful = RangeExponent(0.9, 0.33)
    assert kind_words([doubtful], "depth") is None
    assert kind_words([doubtful] * 4, "depth") is not None
    assert kind_words([RangeExponent(4.0, 0.3)] * 4, "depth") is None  # no range either
    assert kind_words([], "depth") is None
