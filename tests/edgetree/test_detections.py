"""Detections hold consistent arrays, and masks land on the right pixels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from edgetree.detections import TreeDetections
from edgetree.errors import InputError
from edgetree.masks import encode_rle, paste_mask


def _detections(count: int = 3) -> TreeDetections:
    rng = np.random.default_rng(0)
    corner = rng.uniform(0, 40, (count, 2))
    boxes = np.concatenate([corner, corner + rng.uniform(5, 40, (count, 2))], axis=1)
    return TreeDetections(
        boxes_px=boxes.astype(np.float32),
        scores=np.linspace(0.9, 0.1, count, dtype=np.float32),
        keypoints_px=rng.uniform(0, 80, (count, 5, 3)).astype(np.float32),
        masks=rng.uniform(0, 1, (count, 28, 28)).astype(np.float32),
        image_width=90,
        image_height=80,
    )


@pytest.mark.parametrize(
    ("name", "shape"),
    [("boxes_px", (3, 5)), ("keypoints_px", (3, 4, 3)), ("masks", (2, 28, 28)), ("scores", (3, 1))],
)
def test_an_array_of_another_shape_is_named(name: str, shape: tuple[int, ...]) -> None:
    message = rf"{name} has shape \({shape[0]}, {shape[1]}.*expected \("
    with pytest.raises(InputError, match=message):
        dataclasses.replace(_detections(), **{name: np.zeros(shape, np.float32)})


@pytest.mark.parametrize("name", ["boxes_px", "scores", "keypoints_px", "masks"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_named(name: str, value: float) -> None:
    trees = _detections()
    array = getattr(trees, name).copy()
    array[1] = value
    with pytest.raises(InputError, match=f"{name} has NaN or infinite values: expected finite"):
        dataclasses.replace(trees, **{name: array})


@pytest.mark.parametrize("score", [-0.1, 1.1])
def test_scores_are_probabilities(score: float) -> None:
    with pytest.raises(InputError, match=r"scores are .*: expected probabilities, 0 to 1"):
        dataclasses.replace(_detections(), scores=np.array([0.5, score, 0.1], np.float32))


def test_selecting_keeps_rows_together() -> None:
    trees = _detections()
    kept = trees.above(0.5)
    assert len(kept) == 2
    assert kept.keypoints_px is not None
    assert trees.keypoints_px is not None
    np.testing.assert_array_equal(kept.boxes_px, trees.boxes_px[:2])
    np.testing.assert_array_equal(kept.keypoints_px, trees.keypoints_px[:2])
    np.testing.assert_array_equal(trees.select(np.array([2])).mask(0), trees.mask(2))


def test_no_trees_is_an_ordinary_result() -> None:
    none = _detections().above(2.0)
    assert len(none) == 0
    assert none.boxes_px.shape == (0, 4)


def test_a_model_without_masks_says_so() -> None:
    with pytest.raises(InputError, match="without"):
        dataclasses.replace(_detections(), masks=None).mask(0)


def _reference_paste(
    probability: NDArray[np.float32], box: NDArray[np.float32], width: int, height: int
) -> NDArray[np.float64]:
    """The sampling rule written out for one pixel at a time."""
    padded = np.pad(probability.astype(np.float64), 1)
    cells = probability.shape[0]
    values = np.zeros((height, width))
    for row in range(height):
        for column in range(width):
            u = (column + 0.5 - box[0]) / (box[2] - box[0]) * cells - 0.5
            v = (row + 0.5 - box[1]) / (box[3] - box[1]) * cells - 0.5
            if -1 < u < cells and -1 < v < cells:
                c, r = int(np.floor(u)), int(np.floor(v))
                patch = padded[r + 1 : r + 3, c + 1 : c + 3]
                a, b = u - c, v - r
                values[row, column] = np.array([1 - b, b]) @ patch @ np.array([1 - a, a])
    return values


@pytest.mark.parametrize(
    "box",
    [(10.3, 5.7, 31.9, 44.1), (-8.2, -3.0, 70.5, 66.6), (20.0, 20.0, 21.5, 22.5), (0, 0, 60, 50)],
)
def test_pasting_follows_the_sampling_rule(box: tuple[float, ...]) -> None:
    probability = np.random.default_rng(1).uniform(0, 1, (28, 28)).astype(np.float32)
    box_px = np.array(box, dtype=np.float32)
    expected = _reference_paste(probability, box_px, 60, 50)
    pasted = paste_mask(probability, box_px, 60, 50)
    sure = np.abs(expected - 0.5) > 1e-5
    np.testing.assert_array_equal(pasted[sure], expected[sure] >= 0.5)


def test_a_full_mask_fills_exactly_its_box() -> None:
    box_px = np.array([10.0, 4.0, 38.0, 60.0], dtype=np.float32)
    expected = np.zeros((70, 50), dtype=bool)
    expected[4:60, 10:38] = True
    pasted = paste_mask(np.ones((28, 28), np.float32), box_px, 50, 70)
    np.testing.assert_array_equal(pasted, expected)


@pytest.mark.parametrize("box", [(-30.0, 0.0, -10.0, 20.0), (5.0, 5.0, 5.0, 9.0), (99, 0, 120, 9)])
def test_a_box_without_pixels_gives_an_empty_mask(box: tuple[float, ...]) -> None:
    pasted = paste_mask(np.ones((28, 28), np.float32), np.array(box, np.float32), 40, 30)
    assert pasted.shape == (30, 40)
    assert not pasted.any()


def test_rle_is_read_by_the_coco_tools() -> None:
    coco = pytest.importorskip("pycocotools.mask")
    rng = np.random.default_rng(2)
    blob = np.zeros((720, 1280), dtype=bool)
    blob[100:700, 400:470] = True
    speckle = rng.uniform(size=(61, 47)) < 0.4
    for mask in (blob, speckle, ~speckle, np.zeros((5, 4), bool), np.ones((5, 4), bool)):
        rle = encode_rle(mask)
        np.testing.assert_array_equal(coco.decode(rle).astype(bool), mask)
        reference = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
        assert rle["counts"] == reference["counts"].decode()


def test_rle_of_a_known_mask() -> None:
    mask = np.array([[0, 1, 1], [0, 1, 0]], dtype=bool)
    # Down the columns: two zeros, three ones, one zero.
    assert encode_rle(mask) == {"size": [2, 3], "counts": "231"}
