"""What the values of a depth map mean: unit, kind and correction, for all types of numbers."""

from __future__ import annotations

import numpy as np
import pytest

import calib
from calib import DepthConvention, DepthError, DepthScale, PinholeCamera

CAMERA = PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5)
SLOPE_M = np.tile(np.linspace(2, 6, 64, dtype=np.float32), (48, 1))
SCALE = DepthScale(1.02, -0.05, 0.001, 0.002, -0.9, 0.5, 4.0)


@pytest.mark.parametrize("dtype", ["u2", "i2", "u4", "i4", "u8", "i8", ">u2", "f4", "f8", ">f4"])
@pytest.mark.parametrize("scale_m", [0.001, 0.0002, 1 / 256])
def test_a_scale_is_for_all_types_of_numbers(dtype: str, scale_m: float) -> None:
    steps = np.rint(SLOPE_M / scale_m).clip(0, 32767).astype(dtype)
    metres = DepthConvention(scale_m).metres(steps, "a")
    assert metres.dtype == np.float32
    np.testing.assert_allclose(metres, steps.astype(float) * scale_m, rtol=1e-6)


def test_without_a_scale_integers_are_millimetres_and_floats_metres() -> None:
    for dtype in (np.uint16, np.int32, np.uint64):
        steps = np.rint(SLOPE_M * 1000).astype(dtype)
        np.testing.assert_allclose(DepthConvention().metres(steps, "a"), steps / 1000, rtol=1e-6)
    for dtype in (np.float16, np.float32, np.float64):
        values = SLOPE_M.astype(dtype)
        np.testing.assert_array_equal(DepthConvention().metres(values, "a"), values)


@pytest.mark.parametrize("unit_per_m", [100, 1000, 10_000])
def test_floats_that_cannot_be_metres_are_refused_with_the_scale_to_give(unit_per_m: int) -> None:
    values = SLOPE_M * unit_per_m
    with pytest.raises(DepthError, match=r"frame 3 is floating point .*--depth-scale 0\.001"):
        DepthConvention().metres(values, "frame 3")
    metres = DepthConvention(1 / unit_per_m).metres(values, "frame 3")
    np.testing.assert_allclose(metres, SLOPE_M, rtol=1e-6)


def test_values_that_are_no_reading_become_0() -> None:
    values = np.array([[np.nan, np.inf, -np.inf, -1, 1e300, 0, 2]])
    assert DepthConvention().metres(values, "a").tolist() == [[0, 0, 0, 0, 0, 0, 2]]
    assert DepthConvention(0.5).metres(values, "a").tolist() == [[0, 0, 0, 0, 0, 0, 1]]
    assert DepthConvention().metres(np.array([[-5, 0, 2000]]), "a").tolist() == [[0, 0, 2]]


def test_a_half_float_does_not_overflow_before_it_is_scaled() -> None:
    values = np.full((2, 2), 5000, np.float16)
    assert DepthConvention(100.0).metres(values, "a")[0, 0] == pytest.approx(500_000)


def test_8_bits_need_a_scale() -> None:
    values = np.full((4, 4), 50, np.uint8)
    with pytest.raises(DepthError, match="a holds integers of 8 bits, whose unit cannot be told"):
        DepthConvention().metres(values, "a")
    assert DepthConvention(0.1).metres(values, "a")[0, 0] == pytest.approx(5.0)


def test_a_range_becomes_depth_before_it_is_corrected() -> None:
    ranges_m = calib.depth_to_range(SLOPE_M, CAMERA)
    np.testing.assert_allclose(
        DepthConvention(kind="range").metres(ranges_m, "a", CAMERA), SLOPE_M, rtol=1e-5
    )
    millimetres = np.rint(ranges_m * 1000).astype(np.uint16)
    both = DepthConvention(0.001, "range", SCALE).metres(millimetres, "a", CAMERA)
    np.testing.assert_allclose(both, SLOPE_M * 1.02 - 0.05, atol=1e-3)


def test_a_range_needs_the_camera_of_its_pixels() -> None:
    with pytest.raises(DepthError, match=r"a is a range along the rays: expected the camera"):
        DepthConvention(kind="range").metres(SLOPE_M, "a")
    with pytest.raises(calib.CameraError):
        DepthConvention(kind="range").metres(SLOPE_M, "a", CAMERA.scaled(32, 24))


@pytest.mark.parametrize("scale_m", [0, -0.001, np.nan, np.inf, 1e300, 1e-300, "1", True, 10**400])
def test_absurd_scales_are_refused(scale_m: float) -> None:
    with pytest.raises(DepthError, match=r"depth_scale_m is .*: expected metres per unit, 1e-06"):
        DepthConvention(scale_m)
    with pytest.raises(DepthError, match="depth_kind is radial: expected depth, which is along"):
        DepthConvention(kind="radial")  # type: ignore[arg-type]
