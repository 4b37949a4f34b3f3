"""Letterboxing: size, position, padding, and mapping of points."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from calib import CameraError, Letterbox
from calib.shrinking import shrink


@pytest.mark.parametrize(
    ("source", "resized"),
    [
        ((1280, 720), (640, 360)),
        ((640, 384), (640, 384)),
        ((320, 100), (640, 200)),
        ((333, 720), (178, 384)),
        ((1000, 333), (640, 213)),
        ((9000, 1), (640, 1)),
    ],
)
def test_the_image_is_resized_to_the_largest_size_that_fits(
    source: tuple[int, int], resized: tuple[int, int]
) -> None:
    box = Letterbox.fit(*source, 640, 384)
    assert (box.resized_width, box.resized_height) == resized


def test_the_image_is_placed_top_left_and_padded() -> None:
    box = Letterbox.fit(20, 10, 16, 16)
    for shape in ((10, 20), (10, 20, 3)):
        placed = box.apply(np.full(shape, 200, np.uint8), 7)
        assert placed.shape == (16, 16, *shape[2:])
        assert placed.dtype == np.uint8
        assert (placed[:8] == 200).all()
        assert (placed[8:] == 7).all()


def test_an_image_of_the_models_size_is_unchanged() -> None:
    image = np.random.default_rng(0).integers(0, 256, (12, 30, 3), dtype=np.uint8)
    assert (Letterbox.fit(30, 12, 30, 12).apply(image, 0) == image).all()


def test_shrinking_averages_areas() -> None:
    stripes = np.tile(np.array([0, 0, 0, 200], np.uint8), (8, 4))
    shrunk = Letterbox.fit(16, 8, 4, 2).apply(stripes, 0)
    assert (shrunk == 50).all()


@pytest.mark.parametrize(
    ("size", "shrunk"),
    [
        ((1280, 720), (800, 450)),
        ((1920, 1080), (800, 450)),
        ((120, 96), (75, 90)),
        ((1280, 720), (640, 360)),
        ((848, 480), (800, 453)),
        ((333, 720), (178, 384)),
        ((7, 5), (3, 5)),
        ((6, 9), (6, 1)),
    ],
)
@pytest.mark.parametrize("channels", [(), (3,)])
def test_shrinking_gives_what_opencv_gives(
    size: tuple[int, int], shrunk: tuple[int, int], channels: tuple[int, ...]
) -> None:
    image = np.random.default_rng(1).integers(0, 256, (*size[::-1], *channels), np.uint8)
    found = shrink(image, *shrunk)
    expected = cv2.resize(image, shrunk, interpolation=cv2.INTER_AREA)
    assert (found.dtype, found.shape) == (np.uint8, (*shrunk[::-1], *channels))
    off = np.abs(found.astype(int) - expected)
    assert off.max() <= 1  # means half way between two levels
    assert (off > 0).mean() < 0.005


def test_enlarging_interpolates() -> None:
    step = np.repeat(np.array([[0, 100]], np.uint8), 2, 0)
    grown = Letterbox.fit(2, 2, 8, 8).apply(step, 0)
    np.testing.assert_allclose(grown[4], [0, 0, 12.5, 37.5, 62.5, 87.5, 100, 100], atol=0.5)


def test_points_scale_per_axis_and_round_trip() -> None:
    box = Letterbox.fit(1000, 333, 640, 384)
    corner = box.to_model([[1000.0, 333.0], [0.0, 0.0]])
    assert corner.tolist() == [[640.0, 213.0], [0.0, 0.0]]


SIDES = st.integers(1, 4000)
BOXES = st.builds(Letterbox.fit, SIDES, SIDES, st.integers(1, 1300), st.integers(1, 1300))
POINTS = st.lists(st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)), min_size=1, max_size=5)


@given(BOXES, POINTS)
def test_points_survive_the_way_into_the_model_and_back(
    box: Letterbox, points: list[tuple[float, float]]
) -> None:
    np.testing.assert_allclose(box.to_source(box.to_model(points)), points, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(box.to_model(box.to_source(points)), points, rtol=1e-12, atol=1e-12)


@given(BOXES)
def test_the_copy_fills_one_side_and_keeps_the_aspect(box: Letterbox) -> None:
    assert 1 <= box.resized_width <= box.width
    assert 1 <= box.resized_height <= box.height
    assert box.resized_width == box.width or box.resized_height == box.height
    scale = min(box.width / box.source_width, box.height / box.source_height)
    for resized, source in (
        (box.resized_width, box.source_width),
        (box.resized_height, box.source_height),
    ):
        assert resized == 1 or abs(resized - source * scale) <= 0.5 + 1e-9
    corner = box.to_model([box.source_width, box.source_height])
    np.testing.assert_allclose(corner, [box.resized_width, box.resized_height], rtol=1e-12)


SMALL_SIDES = st.integers(8, 60)


@given(
    st.builds(Letterbox.fit, SMALL_SIDES, SMALL_SIDES, SMALL_SIDES, SMALL_SIDES),
    st.integers(0, 255),
    st.integers(0, 255),
)
def test_even_images_stay_even_and_the_rest_is_padding(
    box: Letterbox, value: int, pad_value: int
) -> None:
    placed = box.apply(
        np.full((box.source_height, box.source_width, 3), value, np.uint8), pad_value
    )
    inside = np.zeros((box.height, box.width), bool)
    inside[: box.resized_height, : box.resized_width] = True
    assert (placed[inside] == value).all()
    assert (placed[~inside] == pad_value).all()


@given(st.integers(20, 80), st.integers(20, 80), st.integers(20, 120), st.integers(20, 120))
def test_a_ramp_is_found_where_to_source_says(
    source_width: int, source_height: int, width: int, height: int
) -> None:
    """In an image of a column's own number, each model pixel shows the column it comes from."""
    box = Letterbox.fit(source_width, source_height, width, height)
    assume(min(box.resized_width, box.resized_height) > 4)
    ramp = np.tile(np.arange(source_width, dtype=np.uint8) * 3, (source_height, 1))
    placed = box.apply(ramp, 0)[: box.resized_height, : box.resized_width]
    middles = np.stack([np.arange(box.resized_width) + 0.5, np.full(box.resized_width, 0.5)], -1)
    expected = np.clip(box.to_source(middles)[:, 0] - 0.5, 0, source_width - 1) * 3
    np.testing.assert_allclose(placed[box.resized_height // 2], expected, atol=2.5)


def test_to_model_locates_a_feature() -> None:
    image = np.zeros((720, 1280), np.uint8)
    image[400:408, 900:908] = 255
    box = Letterbox.fit(1280, 720, 640, 384)
    rows, columns = np.nonzero(box.apply(image, 0))
    middle = [columns.mean() + 0.5, rows.mean() + 0.5]
    np.testing.assert_allclose(middle, box.to_model([904.0, 404.0]), atol=1e-9)


def test_other_images_and_sizes_are_rejected() -> None:
    with pytest.raises(CameraError) as caught:
        Letterbox.fit(20, 10, 16, 16).apply(np.zeros((20, 10), np.uint8), 0)
    assert str(caught.value) == "the image is 10x20 px: expected 20x10"
    with pytest.raises(CameraError, match="cannot fit 0x10 px into 16x16"):
        Letterbox.fit(0, 10, 16, 16)
