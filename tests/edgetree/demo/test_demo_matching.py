"""Matching of detections with the ground truth."""

import numpy as np
import pytest

from edgetree.demo.matching import Match, match_boxes


def test_the_first_detection_takes_the_tree_and_each_tree_is_matched_once() -> None:
    truth = np.array([[0.0, 0.0, 10.0, 10.0], [100.0, 0.0, 110.0, 10.0]])
    detected = np.array([[0.0, 0.0, 10.0, 8.0], [0.0, 0.0, 10.0, 10.0], [100.0, 0.0, 110.0, 9.0]])
    matches = match_boxes(detected, truth)
    assert [(m.detection, m.truth) for m in matches] == [(0, 0), (2, 1)]
    assert matches[0].iou == pytest.approx(0.8)


def test_a_detection_takes_the_tree_it_overlaps_most() -> None:
    truth = np.array([[0.0, 0.0, 10.0, 6.0], [0.0, 0.0, 10.0, 10.0]])
    (match,) = match_boxes(np.array([[0.0, 0.0, 10.0, 9.0]]), truth)
    assert match == Match(0, 1, pytest.approx(0.9))


def test_an_iou_of_one_half_is_a_match() -> None:
    truth = np.array([[0.0, 0.0, 10.0, 10.0]])
    assert len(match_boxes(np.array([[0.0, 0.0, 10.0, 5.0]]), truth)) == 1
    assert match_boxes(np.array([[0.0, 0.0, 10.0, 4.9]]), truth) == []


@pytest.mark.parametrize(("detections", "trees"), [(0, 2), (2, 0), (0, 0)])
def test_empty_frames_match_nothing(detections: int, trees: int) -> None:
    assert match_boxes(np.ones((detections, 4)), np.ones((trees, 4))) == []
