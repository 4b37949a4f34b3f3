"""Statistics of how a picture looks have the values that they are named for."""

from __future__ import annotations

import numpy as np
import pytest

from calib import DepthEncoding, encode_depth, picture_statistics, usual_ranges


def test_an_even_colour_has_its_levels_and_no_contrast() -> None:
    image = np.full((64, 96, 3), (40, 120, 60), np.uint8)
    found = picture_statistics(image)
    assert found["lightness"] == pytest.approx(0.114 * 40 + 0.587 * 120 + 0.299 * 60, abs=1)
    assert (found["green_red"], found["blue_yellow"], found["saturation"]) == (60, -50, 80)
    assert found["contrast"] == found["texture"] == found["local_contrast"] == 0


def test_shares_and_directions_are_those_of_the_picture() -> None:
    image = np.full((64, 96, 3), 100, np.uint8)
    image[:32] = 255
    image[32:, :24] = 0
    found = picture_statistics(image)
    assert found["blown_percent"] == pytest.approx(50)
    assert found["black_percent"] == pytest.approx(12.5)
    assert found["top_bottom"] > 150
    stripes = np.zeros((64, 96, 3), np.uint8)
    stripes[:, ::2] = 200
    assert picture_statistics(stripes)["upright"] == pytest.approx(1)
    assert picture_statistics(stripes.transpose(1, 0, 2).copy())["upright"] == pytest.approx(0)


def test_noise_is_finer_than_a_slope_of_the_same_contrast() -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (96, 96, 1), np.uint8).repeat(3, 2)
    slope = np.linspace(0, 255, 96).astype(np.uint8)[:, None, None] + np.zeros((1, 96, 3), np.uint8)
    fine, soft = picture_statistics(noise), picture_statistics(slope)
    assert fine["contrast"] == pytest.approx(soft["contrast"], rel=0.2)
    for name in ("texture", "local_contrast"):
        assert fine[name] > 5 * soft[name]


def test_depth_is_told_in_metres() -> None:
    depth_m = np.full((96, 64), 4.0, np.float32)
    depth_m[:32] = 10.0
    depth_m[:, :16] = 0.0
    encoding = DepthEncoding()
    found = picture_statistics(encode_depth(depth_m, encoding), encoding)
    assert found["reading_percent"] == pytest.approx(75)
    assert found["median_m"] == pytest.approx(4, abs=0.05)
    assert found["spread_m"] == pytest.approx(6, abs=0.1)
    assert found["top_bottom_m"] == pytest.approx(6, abs=0.1)
    assert found["texture_m"] == 0


def test_depth_without_readings_has_only_their_share() -> None:
    nothing = np.full((40, 40), 255, np.uint8)
    assert picture_statistics(nothing, DepthEncoding()) == {"reading_percent": 0}


@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (50, 1), (33, 7)])
def test_any_size_has_finite_statistics(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    colour = rng.integers(0, 256, (*shape, 3), np.uint8)
    depth = rng.integers(0, 256, shape, np.uint8)
    for found in (picture_statistics(colour), picture_statistics(depth, DepthEncoding())):
        assert np.isfinite(list(found.values())).all()


def test_usual_ranges_leave_out_the_rarest_pictures() -> None:
    pictures = [{"a": float(value)} for value in range(101)]
    assert usual_ranges([*pictures, {"b": 5.0}]) == {"a": (1.0, 99.0), "b": (5.0, 5.0)}
