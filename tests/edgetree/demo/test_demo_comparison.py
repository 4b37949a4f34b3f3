"""Comparison of measurements with the ground truth, per tree and over all trees."""

import json
from dataclasses import replace

import numpy as np
import pytest

from edgetree.demo.comparison import compare_trees, summarise
from edgetree.demo.matching import Match
from edgetree.measure import Estimate, Failure, TreeMeasurement
from edgetree.samples import SampleTree


def truth(diameter_m: float) -> SampleTree:
    return SampleTree(
        box_px=np.array([0.0, 0.0, 10.0, 10.0], np.float32),
        keypoints_px=np.zeros((5, 3), np.float32),
        diameter_m=diameter_m,
        cut_height_m=0.2,
        distance_m=5.0,
        inclination_deg=0.0,
        visible_fraction=1.0,
        species="fir",
    )


def measured(diameter: Estimate | Failure) -> TreeMeasurement:
    return replace(
        TreeMeasurement.failed("no ground"),
        diameter_m=diameter,
        distance_m=Estimate(5.1, 0.05),
    )


def test_each_true_tree_gets_the_measurement_of_its_own_detection() -> None:
    truths = [truth(0.3), truth(0.4), truth(0.5)]
    measurements = [measured(Estimate(0.11, 0.01)), measured(Estimate(0.41, 0.01))]
    frame = compare_trees("one", truths, [Match(1, 0, 0.9)], [0.9, 0.8], measurements)
    assert [tree.found for tree in frame.trees] == [True, False, False]
    found = frame.trees[0].compared("diameter_m")
    assert found is not None
    assert found.measured == Estimate(0.41, 0.01)
    assert frame.trees[0].score == 0.8
    assert frame.trees[1].compared("diameter_m") is None
    assert frame.unmatched_detections == 1


def test_a_row_has_the_value_or_the_reason() -> None:
    frame = compare_trees(
        "one", [truth(0.3), truth(0.2)], [Match(0, 0, 0.9)], [0.9], [measured(Estimate(0.31, 0.02))]
    )
    found, missed = (json.loads(json.dumps(tree.to_dict())) for tree in frame.trees)
    assert found["true_diameter_m"] == 0.3
    assert found["diameter_m"] == 0.31
    assert found["diameter_std_m"] == 0.02
    assert found["cut_height_failure"] == "no ground"
    assert "cut_height_m" not in found
    assert missed == {
        "found": False,
        "score": None,
        "true_diameter_m": 0.2,
        "true_cut_height_m": 0.2,
        "true_distance_m": 5.0,
    }


def test_medians_and_shares_are_over_all_measured_trees_of_all_frames() -> None:
    frames = [
        compare_trees(
            "a", [truth(0.2)], [Match(0, 0, 1.0)], [0.9], [measured(Estimate(0.21, 0.02))]
        ),
        compare_trees(
            "b",
            [truth(0.4), truth(0.5), truth(0.6)],
            [Match(0, 0, 1.0), Match(1, 1, 1.0)],
            [0.9, 0.8],
            [measured(Estimate(0.37, 0.02)), measured(Estimate(0.59, 0.02))],
        ),
    ]
    summary = summarise(frames, "diameter_m")
    assert summary.measured == 3
    assert summary.median_abs_error_m == pytest.approx(0.03)
    assert summary.median_relative_error == pytest.approx(0.03 / 0.4)
    assert summary.within_one_std == pytest.approx(1 / 3)
    assert summary.within_two_std == pytest.approx(2 / 3)


def test_a_failed_estimate_is_not_zero() -> None:
    failed = compare_trees(
        "a", [truth(0.2)], [Match(0, 0, 1.0)], [0.9], [measured(Failure("no depth at the stem"))]
    )
    assert summarise([failed], "diameter_m") == (0, None, None, None, None)
    assert summarise([failed], "distance_m").measured == 1
    assert summarise([], "diameter_m").measured == 0
