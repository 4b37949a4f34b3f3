"""TreeDetections checks its arrays and resamples masks to the right pixels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.detections import TreeDetections


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
def test_scores_outside_the_range_are_rejected(score: float) -> None:
    with pytest.raises(InputError, match=r"scores are .*: expected probabilities, 0 to 1"):
        dataclasses.replace(_detections(), scores=np.array([0.5, score, 0.1], np.float32))


def test_selecting_applies_to_all_arrays() -> None:
    trees = _detections()
    kept = trees.above(0.5)
    assert len(kept) == 2
    assert kept.keypoints_px is not None
    assert trees.keypoints_px is not None
    np.testing.assert_array_equal(kept.boxes_px, trees.boxes_px[:2])
    np.testing.assert_array_equal(kept.keypoints_px, trees.keypoints_px[:2])
    np.testing.assert_array_equal(trees.select(np.array([2])).mask(0), trees.mask(2))


def test_no_trees_is_a_valid_result() -> None:
    none = _detections().above(2.0)
    assert len(none) == 0
    assert none.boxes_px.shape == (0, 4)


def test_masks_of_a_model_without_masks_are_an_error() -> None:
    with pytest.raises(InputError, match="has no mask output"):
        dataclasses.replace(_detections(), masks=None).mask(0)
