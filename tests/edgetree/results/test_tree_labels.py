"""Labels show measured values only; the tables give the reasons for missing ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree.detections import TreeDetections
from edgetree.measure import Estimate, Evidence, Failure, PointEstimate, TreeMeasurement
from edgetree.results.tree_labels import cut_marks, numbered, tree_labels

TREES = TreeDetections(
    boxes_px=np.array([[1, 1, 5, 9]], np.float32),
    scores=np.array([0.873], np.float32),
    keypoints_px=None,
    masks=None,
    image_width=20,
    image_height=10,
)
MEASURED = replace(
    TreeMeasurement.failed("not looked at"),
    diameter_m=Estimate(0.3124, 0.0081),
    dbh_m=Estimate(0.289, 0.0112),
    cut_height_m=Estimate(0.148, 0.02),
    distance_m=Estimate(5.26, 0.05),
    cut_point_m=PointEstimate(np.array([0.5, 0.25, 5.0]), np.full(3, 0.02)),
)


def test_without_measurements_a_label_shows_the_score() -> None:
    assert tree_labels(TREES) == [["tree 87%"]]


def test_measurements_are_shown_with_their_standard_deviation() -> None:
    (label,) = tree_labels(TREES, [MEASURED])
    assert label == ["Ø 31.2 ±0.8 cm", "DBH 28.9 ±1.1 cm", "cut 15 cm  dist 5.26 m"]


def test_missing_values_are_left_out() -> None:
    partly = replace(MEASURED, dbh_m=Failure("too low"), cut_height_m=Failure("no ground"))
    (label,) = tree_labels(TREES, [partly])
    assert label == ["Ø 31.2 ±0.8 cm", "dist 5.26 m"]
    partly = replace(MEASURED, diameter_m=Failure("no edges"), cut_height_m=Failure("no ground"))
    assert tree_labels(TREES, [partly]) == [["DBH 28.9 ±1.1 cm", "dist 5.26 m"]]


def test_a_tree_without_values_gets_only_its_number() -> None:
    failed = replace(
        TreeMeasurement.failed("no depth on the stem"), evidence=Evidence(warnings=("far",))
    )
    labels = tree_labels(TREES, [failed])
    assert labels == [[]]
    assert numbered(labels, (4,)) == [["4"]]


def test_a_warning_is_a_sign_behind_the_first_line() -> None:
    warned = replace(MEASURED, evidence=Evidence(warnings=("the stump is high", "and more")))
    label = tree_labels(TREES, [warned])[0]
    assert label == ["Ø 31.2 ±0.8 cm  !", "DBH 28.9 ±1.1 cm", "cut 15 cm  dist 5.26 m"]


def test_labels_start_with_the_number() -> None:
    assert numbered([["a", "b"], ["c"]], (7, "?")) == [["7  a", "b"], ["?  c"]]


def test_the_cut_mark_is_the_projected_cut_point() -> None:
    camera = PinholeCamera(200, 100, 100.0, 100.0, 99.5, 49.5)
    mark, none = cut_marks([MEASURED, TreeMeasurement.failed("no depth")], camera)
    assert none is None
    assert mark is not None
    assert mark.xy_px == pytest.approx((110, 55))
    assert mark.text == "15 cm"
