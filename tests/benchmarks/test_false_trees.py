"""What the false trees of model files are."""

from pathlib import Path

import numpy as np

from benchmarks.false_trees import kinds
from edgetree import TreeDetections
from perceptree.data import FrameRecord
from perceptree.data.coco import TreeRecord

WIDTH_PX, HEIGHT_PX = 320, 180


def stem(left: float, distance_m: float) -> TreeRecord:
    box_px = np.array([left, 20, left + 30, 160])
    return TreeRecord(1, box_px, np.zeros((5, 3)), None, False, {"distance_m": distance_m})


def frame(*trees: TreeRecord) -> FrameRecord:
    return FrameRecord(1, Path("1.jpg"), None, None, WIDTH_PX, HEIGHT_PX, {}, trees)


def detections(*lefts: float) -> TreeDetections:
    count = len(lefts)
    boxes = [[left, 20, left + 30, 160] for left in lefts]
    return TreeDetections(
        np.array(boxes, np.float32).reshape(-1, 4),
        np.linspace(0.9, 0.6, count, dtype=np.float32),
        np.zeros((count, 5, 3), np.float32),
        np.ones((count, 28, 28), np.float32),
        WIDTH_PX,
        HEIGHT_PX,
    )


def test_each_detection_is_of_one_kind() -> None:
    labelled = frame(stem(50, 5.0), stem(100, 10.0), stem(200, 10.1))
    found = detections(52, 55, 100, 202, 218, 290)
    assert list(kinds(found, labelled, 10.0)) == [
        "right",
        "again",
        "right",
        "further",
        "loose",
        "other",
    ]


def test_a_stem_within_reach_goes_before_one_beyond_it() -> None:
    labelled = frame(stem(50, 11.0), stem(52, 5.0))
    assert list(kinds(detections(50), labelled, 10.0)) == ["right"]


def test_frames_without_trees_have_only_other_detections() -> None:
    assert list(kinds(detections(50, 200), frame(), 10.0)) == ["other", "other"]
    assert list(kinds(detections(), frame(stem(50, 5.0)), 10.0)) == []
