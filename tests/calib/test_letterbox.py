"""Letterboxing: size, position, padding, and mapping of points."""

import numpy as np
import pytest

from calib import CameraError, Letterbox


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


def test_enlarging_interpolates() -> None:
    step = np.repeat(np.array([[0, 100]], np.uint8), 2, 0)
    grown = Letterbox.fit(2, 2, 8, 8).apply(step, 0)
    np.testing.assert_allclose(grown[4], [0, 0, 12.5, 37.5, 62.5, 87.5, 100, 100], atol=0.5)


def test_points_scale_per_axis_and_round_trip() -> None:
    box = Letterbox.fit(1000, 333, 640, 384)
    corner = box.to_model([[1000.0, 333.0], [0.0, 0.0]])
    assert corner.tolist() == [[640.0, 213.0], [0.0, 0.0]]
    points = np.random.default_rng(0).uniform(0, 900, (3, 5, 2))
    np.testing.assert_allclose(box.to_source(box.to_model(points)), points, atol=1e-9)


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
