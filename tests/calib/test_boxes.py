"""Intersection over union of boxes."""

import numpy as np
import pytest

from calib import box_iou


def test_overlap_is_shared_over_joint_area() -> None:
    boxes = np.array([[0.0, 0.0, 2.0, 2.0], [1.0, 0.0, 3.0, 2.0], [5.0, 5.0, 6.0, 6.0]])
    iou = box_iou(boxes[:2], boxes)
    assert iou == pytest.approx(np.array([[1.0, 1 / 3, 0.0], [1 / 3, 1.0, 0.0]]))


def test_boxes_without_area_overlap_nothing() -> None:
    point = np.array([[1.0, 1.0, 1.0, 1.0]])
    assert box_iou(point, point) == pytest.approx(np.zeros((1, 1)))
    upside_down = np.array([[2.0, 2.0, 0.0, 0.0]])
    assert box_iou(upside_down, np.array([[0.0, 0.0, 2.0, 2.0]])) == pytest.approx(np.zeros((1, 1)))
