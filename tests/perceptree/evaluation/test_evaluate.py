"""Metrics: perfect predictions score 100, and known errors have known effects."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from perceptree.errors import DatasetError
from perceptree.evaluation import RawDetections, evaluate, predict_frames

Edit = Callable[[Path, str, Callable[[dict[str, Any]], None]], None]


@pytest.mark.parametrize("batch", [1, 4])
def test_perfect_predictions_score_100(posts: Path, store_of: Any, oracle: Any, batch: int) -> None:
    store = store_of(posts)
    shown: list[int] = []
    metrics = evaluate(oracle(store), store, batch, shown.append)
    assert metrics.frames == sum(shown) == 6
    assert metrics.trees == 9
    assert metrics.box_ap == pytest.approx(100)
    assert metrics.mask_ap == pytest.approx(100)
    assert metrics.keypoint_ap == pytest.approx(100)
    labelled = {"felling_cut", "diameter_left", "diameter_right", "axis_middle"}
    assert set(metrics.keypoint_error_px) == labelled
    assert max(metrics.keypoint_error_px.values()) < 1e-4


def test_predictions_are_in_source_px(posts: Path, store_of: Any, oracle: Any) -> None:
    store = store_of(posts)  # the model sees the frames 1.25 times as large
    for frame, found in zip(store.frames, predict_frames(oracle(store), store, 4), strict=True):
        assert found.boxes == pytest.approx(np.array([tree.box_px for tree in frame.trees]))
        assert found.masks is not None
        assert [runs["size"] for runs in found.masks] == [[72, 128]] * len(frame.trees)


def test_shifted_boxes_lower_box_ap_only(posts: Path, store_of: Any, oracle: Any) -> None:
    def aside(raw: RawDetections) -> RawDetections:
        raw.boxes[..., 0::2] += 0.1 * (raw.boxes[..., 2:3] - raw.boxes[..., 0:1])
        return raw

    store = store_of(posts)
    metrics = evaluate(oracle(store, aside), store)
    # Shifted by a tenth of the width, the IoU is 0.9 / 1.1 = 0.82: seven of ten thresholds.
    assert metrics.box_ap == pytest.approx(70, abs=0.5)
    assert metrics.box_ap50 == pytest.approx(100)
    assert metrics.keypoint_ap == pytest.approx(100)


def test_keypoint_errors_are_medians_in_source_px(posts: Path, store_of: Any, oracle: Any) -> None:
    def right(raw: RawDetections) -> RawDetections:
        assert raw.keypoints is not None
        raw.keypoints[:, :, 0, 0] += 5.0  # model px: 4 source px
        return raw

    store = store_of(posts)
    errors = evaluate(oracle(store, right), store).keypoint_error_px
    assert errors["felling_cut"] == pytest.approx(4.0, abs=1e-3)
    assert errors["diameter_left"] == pytest.approx(0.0, abs=1e-3)


def test_object_keypoint_similarity_has_the_published_sigma(
    posts: Path, store_of: Any, oracle: Any
) -> None:
    def away(raw: RawDetections) -> RawDetections:
        assert raw.keypoints is not None
        # OKS = exp(-d**2 / (2 area (2 sigma)**2)); at d = sqrt(area) / 4 and sigma 0.25: 0.882.
        area = (raw.boxes[..., 2:] - raw.boxes[..., :2]).prod(-1)
        raw.keypoints[..., 1] += 0.25 * np.sqrt(area)[..., None]
        return raw

    store = store_of(posts)
    # Eight of ten thresholds (0.50 to 0.85) lie under 0.882.
    assert evaluate(oracle(store, away), store).keypoint_ap == pytest.approx(80, abs=0.5)


def test_a_model_without_branches_has_no_ap_for_them(
    posts: Path, store_of: Any, oracle: Any
) -> None:
    store = store_of(posts)
    bare = oracle(store, lambda raw: raw._replace(keypoints=None, masks=None))
    metrics = evaluate(bare, store)
    assert metrics.box_ap == pytest.approx(100)
    assert (metrics.mask_ap, metrics.mask_ap50, metrics.keypoint_ap) == (None, None, None)
    assert metrics.keypoint_error_px == {}


def test_no_detections_score_0(posts: Path, store_of: Any, oracle: Any) -> None:
    store = store_of(posts)
    empty = oracle(store, lambda raw: raw._replace(num_detections=0 * raw.num_detections))
    metrics = evaluate(empty, store)
    assert (metrics.box_ap, metrics.mask_ap, metrics.keypoint_ap) == (0.0, 0.0, 0.0)


def test_labels_without_keypoints_give_no_keypoint_ap(
    posts: Path, edit_split: Edit, store_of: Any, oracle: Any
) -> None:
    def change(content: dict[str, Any]) -> None:
        for annotation in content["annotations"]:
            del annotation["keypoints"]

    edit_split(posts, "train", change)
    store = store_of(posts)
    metrics = evaluate(oracle(store), store)
    assert metrics.box_ap == pytest.approx(100)
    assert metrics.keypoint_ap is None


def test_frames_without_trees_cannot_be_evaluated(
    posts: Path, edit_split: Edit, store_of: Any, oracle: Any
) -> None:
    edit_split(posts, "train", lambda content: content["annotations"].clear())
    store = store_of(posts)
    with pytest.raises(DatasetError, match="6 frames without a labelled tree"):
        evaluate(oracle(store), store)


def test_the_evaluation_prints_nothing(
    posts: Path, capsys: pytest.CaptureFixture[str], store_of: Any, oracle: Any
) -> None:
    store = store_of(posts)
    evaluate(oracle(store), store)
    assert capsys.readouterr() == ("", "")
