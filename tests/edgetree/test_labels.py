"""Labels say what was measured, and why not where it was not."""

from __future__ import annotations

import numpy as np

from edgetree.detections import TreeDetections
from edgetree.labels import tree_labels
from edgetree.measure import Estimate, TreeMeasurement

TREES = TreeDetections(
    boxes_px=np.array([[1, 1, 5, 9]], np.float32),
    scores=np.array([0.873], np.float32),
    keypoints_px=None,
    masks=None,
    image_width=20,
    image_height=10,
)


def test_without_metres_a_label_gives_the_score() -> None:
    assert tree_labels(TREES) == [["tree 87%"]]


def test_metres_stand_with_their_uncertainty() -> None:
    measured = TreeMeasurement(
        diameter_m=Estimate(0.3124, 0.0081),
        cut_height_m=Estimate(0.148, 0.02),
        inclination_deg=Estimate(3.0, 1.0),
        distance_m=Estimate(5.26, 0.05),
        cut_point_m=np.zeros(3),
    )
    assert tree_labels(TREES, [measured]) == [["Ø 0.312 ±0.008 m", "cut 0.15 m  dist 5.3 m"]]


def test_a_failure_says_why() -> None:
    failed = TreeMeasurement.failed("no depth at the stem")
    assert tree_labels(TREES, [failed])[0][0] == "Ø ? no depth at the stem"
