"""Overlaps of masks and keypoints of trees and their detections."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import CocoRle, encode_rle
from perceptree.data import FrameRecord, TreeRecord
from perceptree.evaluation.coco_matching import Evaluation
from perceptree.evaluation.precision import SIZES_PX2, _ground_truth, _loaded, _results
from perceptree.evaluation.predictions import FramePrediction
from perceptree.evaluation.reliability import joined, scored_detections

WIDTH_PX, HEIGHT_PX = 300, 50


def rle(rows: slice, columns: slice) -> CocoRle:
    mask = np.zeros((HEIGHT_PX, WIDTH_PX), bool)
    mask[rows, columns] = True
    return encode_rle(mask)


def tree(number: int, left: int) -> TreeRecord:
    box_px = np.array([left, 0, left + 10, 40.0])
    keypoints = np.array([[left + 5, 8.0 * row, 2] for row in range(5)])
    keypoints[4] = 0
    return TreeRecord(
        number, box_px, keypoints, rle(np.s_[0:40], np.s_[left : left + 10]), False, {}
    )


@pytest.fixture
def frame() -> FrameRecord:
    trees = tree(1, 0), tree(2, 200)
    return FrameRecord(7, Path("7.png"), None, None, WIDTH_PX, HEIGHT_PX, {}, trees)


@pytest.fixture
def found() -> FramePrediction:
    lefts = 100, 200, 0
    boxes = np.array([[left, 0, left + 10, 40.0] for left in lefts])
    masks = [
        rle(np.s_[0:40], np.s_[100:110]),
        rle(np.s_[0:10], np.s_[200:210]),
        rle(np.s_[0:40], np.s_[0:5]),
    ]
    keypoints = np.array([[[left + 5 + row, 8.0 * row, 1] for row in range(5)] for left in lefts])
    return FramePrediction(boxes, np.array([0.9, 0.8, 0.7]), keypoints, masks)


def test_masks_and_keypoints_are_compared_with_those_of_the_same_trees(
    frame: FrameRecord, found: FramePrediction
) -> None:
    scored = scored_detections([frame], [found])
    masks, keypoints = scored.others
    assert dict(zip(scored.score, masks, strict=True)) == {0.9: 0, 0.8: 0.25, 0.7: 0.5}
    by_score = dict(zip(scored.score, keypoints, strict=True))
    assert by_score[0.9] == 0
    assert by_score[0.8] == by_score[0.7] > 0.9


def test_the_similarity_of_keypoints_is_that_of_coco(
    frame: FrameRecord, found: FramePrediction
) -> None:
    keypoints = found.keypoints
    assert keypoints is not None
    keypoints[1, :, 1] += np.arange(5) * 12
    truth = _ground_truth([frame])
    entries = _results([frame], [found], "keypoints")
    assert entries is not None
    evaluation = Evaluation(truth, _loaded(truth, entries), "keypoints", SIZES_PX2)
    evaluation.run()
    expected = evaluation.ious[7, 1]
    scored = scored_detections([frame], [found])
    by_score = dict(zip(scored.score, scored.others[1], strict=True))
    assert by_score[0.8] == pytest.approx(expected[1, 1], abs=1e-9)
    assert by_score[0.7] == pytest.approx(expected[2, 0], abs=1e-9)
    assert by_score[0.8] < by_score[0.7] - 0.1


def test_trees_without_masks_or_keypoints_are_unknown(
    frame: FrameRecord, found: FramePrediction
) -> None:
    bare = replace(frame.trees[0], segmentation=None, keypoints=np.zeros((5, 3)))
    scored = scored_detections([replace(frame, trees=(bare, frame.trees[1]))], [found])
    for overlaps in scored.others:
        assert np.isnan(dict(zip(scored.score, overlaps, strict=True))[0.7])
        assert np.isfinite(dict(zip(scored.score, overlaps, strict=True))[0.8])


def test_models_without_masks_and_keypoints_have_neither(
    frame: FrameRecord, found: FramePrediction
) -> None:
    boxes = found._replace(masks=None, keypoints=None)
    assert scored_detections([frame], [boxes]).others == ()


def test_datasets_in_which_nothing_is_found_count_with_others(
    frame: FrameRecord, found: FramePrediction
) -> None:
    sets = [scored_detections([each], [found]) for each in (replace(frame, trees=()), frame)]
    whole = joined(sets)
    assert [len(each) for each in whole.others] == [6, 6]
    assert [len(each) for each in joined(sets[:1]).others] == [3, 3]
