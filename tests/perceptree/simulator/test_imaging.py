"""Camera faults change the look of a picture, but not the position of its content."""

import cv2
import numpy as np
import pytest

from perceptree.simulator.sensors import imaging
from perceptree.simulator.sensors.imaging import (
    CameraFaults,
    apply_lens_faults,
    apply_processing_faults,
    draw_faults,
    infrared,
    saturated,
)
from perceptree.simulator.settings import ImagingSettings

LENS = ("_bloom", "_veil", "_defocus", "_fringes", "_drops", "_dirt")
PROCESSING = (
    "_white_balance",
    "_saturation",
    "_chroma_noise",
    "_curve",
    "_smear",
    "_low_resolution",
    "_sharpen",
    "_banner",
    "_jpeg",
)


def stems() -> np.ndarray:
    """(180, 320, 3) float32 BGR: dark vertical bars under a bright sky."""
    rng = np.random.default_rng(3)
    picture = np.full((180, 320, 3), 0.6, np.float32) + rng.normal(0, 0.02, (180, 320, 3))
    picture[:30] = 0.97
    for x in (40, 95, 170, 260):
        picture[:150, x : x + 17] = (0.12, 0.16, 0.2)
    return np.clip(picture, 0, 1).astype(np.float32)


def moved_px(before: np.ndarray, after: np.ndarray) -> float:
    """Shift of a picture's centre by phase correlation, px."""
    grey = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)[20:160] for image in (before, after)]
    shift, _ = cv2.phaseCorrelate(*(cv2.GaussianBlur(g, (0, 0), 1).astype(float) for g in grey))
    return float(np.hypot(*shift))


@pytest.mark.parametrize("name", LENS)
@pytest.mark.parametrize("seed", range(3))
def test_a_lens_does_not_move_the_picture(name: str, seed: int):
    before = stems()
    after = getattr(imaging, name)(np.random.default_rng(seed), 1.0, before)
    assert after.shape == before.shape
    assert not np.array_equal(after, before)
    assert moved_px(before, np.clip(after, 0, 1).astype(np.float32)) < 0.5


@pytest.mark.parametrize("name", PROCESSING)
@pytest.mark.parametrize("seed", range(3))
def test_processing_does_not_move_the_picture(name: str, seed: int):
    before = (stems() * 255).astype(np.uint8)
    after = getattr(imaging, name)(np.random.default_rng(seed), 1.0, before)
    assert after.shape == before.shape
    assert after.dtype == np.uint8
    assert moved_px(before.astype(np.float32), after.astype(np.float32)) < 0.5


def test_the_same_seed_gives_the_same_picture_and_another_seed_another():
    faults = CameraFaults(1.3, 0.9, 0.0, infrared=False)
    image = (stems() * 255).astype(np.uint8)

    def taken(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        toned = apply_lens_faults(rng, faults.strength, stems())
        assert toned.min() >= 0
        assert toned.max() <= 1
        return apply_processing_faults(rng, faults, image).astype(int) + (255 * toned).astype(int)

    assert np.array_equal(taken(1), taken(1))
    assert not np.array_equal(taken(1), taken(2))


def test_a_camera_without_faults_changes_nothing():
    image = (stems() * 255).astype(np.uint8)
    faults = draw_faults(np.random.default_rng(0), ImagingSettings())
    assert faults == CameraFaults(1.0, 0.0, 0.0, infrared=False)
    assert apply_processing_faults(np.random.default_rng(0), faults, image) is image


def test_leaves_are_bright_in_near_infrared():
    leaf, bark = np.full((2, 2, 3), (40, 90, 45), np.uint8), np.full((2, 2, 3), 60, np.uint8)
    assert infrared(leaf)[0, 0, 0] > 1.8 * infrared(bark)[0, 0, 0]
    assert len(set(infrared(leaf)[0, 0].tolist())) == 1


def test_saturation_moves_colours_away_from_grey():
    colour = np.full((2, 2, 3), (60, 100, 80), np.uint8)
    assert np.ptp(saturated(colour, 2.0)[0, 0]) == pytest.approx(80, abs=2)
    assert np.ptp(saturated(colour, 0.0)[0, 0]) == 0


def test_as_many_cameras_are_faulty_as_asked_for():
    settings = ImagingSettings(share=0.6, strength=(0.2, 0.9), infrared_share=0.5)
    rng = np.random.default_rng(5)
    drawn = [draw_faults(rng, settings) for _ in range(2000)]
    faulty = [faults for faults in drawn if faults.strength]
    assert len(faulty) / len(drawn) == pytest.approx(0.6, abs=0.04)
    assert all(0.2 <= faults.strength <= 0.9 for faults in faulty)
    assert np.mean([faults.infrared for faults in faulty]) == pytest.approx(0.5, abs=0.05)
