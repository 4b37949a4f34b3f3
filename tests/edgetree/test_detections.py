"""TreeDetections checks its arrays and resamples masks to the right pixels."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest

from basetree.errors import InputError, MissingPackage
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
        keypoint_stds_px=rng.uniform(1, 9, (count, 5, 2)).astype(np.float32),
    )


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("boxes_px", (3, 5)),
        ("keypoints_px", (3, 4, 3)),
        ("keypoint_stds_px", (3, 5, 3)),
        ("masks", (2, 28, 28)),
        ("scores", (3, 1)),
    ],
)
def test_an_array_of_another_shape_is_named(name: str, shape: tuple[int, ...]) -> None:
    message = rf"{name} has shape \({shape[0]}, {shape[1]}.*expected \("
    with pytest.raises(InputError, match=message):
        dataclasses.replace(_detections(), **{name: np.zeros(shape, np.float32)})


@pytest.mark.parametrize(
    "name", ["boxes_px", "scores", "keypoints_px", "masks", "keypoint_stds_px"]
)
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


def test_the_short_form_says_what_was_found() -> None:
    assert repr(_detections()) == (
        "<TreeDetections: 3 trees in 90x80 px, scores 0.10 to 0.90, with keypoints and masks>"
    )
    plain = dataclasses.replace(_detections(0), keypoints_px=None, masks=None)
    assert repr(plain) == "<TreeDetections: 0 trees in 90x80 px, with boxes alone>"


def test_rows_hold_one_tree_each() -> None:
    trees = _detections()
    assert trees.keypoints_px is not None
    rows = trees.to_rows()
    assert [row["tree"] for row in rows] == [1, 2, 3]
    assert rows[1]["box_x1_px"] == pytest.approx(trees.boxes_px[1, 2])
    assert rows[2]["axis_top_y_px"] == pytest.approx(trees.keypoints_px[2, 4, 1])
    assert set(dataclasses.replace(trees, keypoints_px=None).to_rows()[0]) == {
        *("tree", "score", "box_x0_px", "box_y0_px", "box_x1_px", "box_y1_px")
    }


def test_a_plot_is_a_changed_copy_of_the_picture() -> None:
    picture = np.zeros((80, 90, 3), np.uint8)
    drawn = _detections().plot(picture)
    assert drawn.shape == picture.shape
    assert drawn.any()
    assert not picture.any()
    with pytest.raises(InputError, match=r"is uint8 \(8, 8, 3\): expected uint8 \(80, 90, 3\)"):
        _detections().plot(picture[:8, :8])


def test_the_hand_over_to_supervision() -> None:
    supervision = pytest.importorskip("supervision")
    trees = _detections()
    for handed in (trees, trees.above(1.0)):
        found = handed.to_supervision()
        assert isinstance(found, supervision.Detections)
        assert len(found) == len(handed)
        np.testing.assert_array_equal(found.xyxy, handed.boxes_px)
        assert found.mask.shape == (len(handed), 80, 90)
    np.testing.assert_array_equal(trees.to_supervision().mask[1], trees.mask(1))


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "supervision", None)
    with pytest.raises(MissingPackage, match="pip install supervision"):
        _detections().to_supervision()
