"""Boards that are bent, stretched or skewed: the camera holds, and the board is named."""

import fake_boards as fake
import numpy as np
import pytest

from calib.boards import BoardView, Calibration, calibrate_camera

SIZE = (640, 480)
# Metres by which a board of 25 cm is bent; shares by which a print is stretched or skewed.
SHAPES = {
    "a cylinder": (0.0, 0.002, 0.0, 0.0, 0.0),
    "a cylinder along a diagonal": (0.0, 0.001, 0.0015, 0.0, 0.0),
    "a saddle": (0.0, 0.0, 0.0015, 0.0, 0.0),
    "a wave": (0.0, 0.0, 0.0, 0.001, 0.0),
    "stretched": (0.015, 0.0, 0.0, 0.0, 0.0),
    "skewed": (0.0, 0.0, 0.0, 0.0, 0.01),
}


def calibrated(shape: tuple[float, ...], seed: int, model: str = "radtan") -> Calibration:
    """Calibrate with a checkerboard of this shape that is taken to be flat."""
    stretch, cylinder_m, twist_m, wave_m, skew = shape
    truth, flat = fake.TRUTH[model], fake.object_points(fake.CHECKERBOARD)
    x, y = ((flat - flat.mean(0)) / 0.125)[:, :2].T
    true = flat.copy()
    true[:, 0] += stretch * flat[:, 0] + skew * flat[:, 1]
    true[:, 2] = cylinder_m * x**2 + 2 * twist_m * x * y + wave_m * np.sin(np.pi * x)
    rng = np.random.default_rng(seed)
    views = []
    for i, pose in enumerate(fake.poses(truth, 20, seed)):
        exact_px = fake.projected(truth, pose, true)
        if (exact_px > 0).all() and (exact_px < SIZE).all():
            views.append(BoardView(f"view{i}", exact_px + rng.normal(0, 0.1, (54, 2)), flat))
    result = calibrate_camera(views, SIZE, model)
    assert isinstance(result, Calibration)
    return result


@pytest.mark.parametrize("name", SHAPES)
def test_the_camera_holds_and_the_board_is_named(name: str) -> None:
    off = []
    for seed in (1000, 1001):
        result = calibrated(SHAPES[name], seed)
        word = {"stretched": "print is stretched", "skewed": "print is skewed"}.get(name, "bent by")
        assert any(word in line for line in result.advice), result.advice
        off += [(p.value - getattr(fake.RADTAN, p.name)) / p.std for p in result.parameters[:4]]
        assert abs(result.camera.fx / fake.RADTAN.fx - 1) < 0.005
        assert result.rms_px < 0.16
    assert np.abs(off).max() < 3


def test_a_flat_board_is_not_named_bent() -> None:
    for seed in (1000, 1001, 1002):
        result = calibrated((0.0,) * 5, seed)
        assert result.passed
        assert not any("bent" in line or "print" in line for line in result.advice)


def test_the_size_of_a_bend_is_told() -> None:
    told = [line for line in calibrated(SHAPES["a cylinder"], 1000).advice if "bent" in line]
    size_mm = float(told[0].split("by ")[1].split(" mm")[0])
    assert size_mm == pytest.approx(2 * 0.8**2, abs=0.35)  # the board's corners are at 0.8


def test_a_stretched_print_seen_by_a_fisheye_lens() -> None:
    result = calibrated(SHAPES["stretched"], 1000, "fisheye")
    off = [(p.value - getattr(fake.FISHEYE, p.name)) / p.std for p in result.parameters[:4]]
    assert np.abs(off).max() < 3
    assert any("stretched along its rows by +1." in line for line in result.advice)
