"""The line of a stem's axis in camera coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from edgetree.measure import Failure, TreeMeasurement, measure_trees


@pytest.mark.parametrize("lean_deg", [0.0, 8.0])
@pytest.mark.parametrize("right_m", [-1.0, 1.5])
def test_axis_goes_through_the_stem(scene, pole, lean_deg, right_m):
    stem = pole(0.3, right_m, 5.0, lean_deg, 30.0)
    stand = scene(stem, pitch_deg=10.0)
    axis = stand.measure().axis
    off = axis.point_m - stand.axis_point(stem, stem.cut_m)
    assert np.abs(off).max() < 0.02
    angle_deg = np.degrees(np.arccos(min(axis.direction @ stand.along(stem), 1.0)))
    assert angle_deg < 0.5


def test_depth_is_the_least_certain_direction(scene, pole):
    stand = scene(pole(0.3, 1.5, 5.0))
    tree = stand.measure(settings=None)
    values, ways = np.linalg.eigh(tree.axis.point_covariance_m2)
    sight = tree.axis.point_m / np.linalg.norm(tree.axis.point_m)
    assert (values > 0).all()
    across = np.array([sight[2], 0.0, -sight[0]])
    assert across @ tree.axis.point_covariance_m2 @ across < 0.5 * values[-1]
    assert tree.axis.direction @ tree.axis.direction_covariance @ tree.axis.direction < 1e-9
    assert np.abs(ways[:, -1] @ across) < 0.5


def test_without_a_cut_the_point_is_at_the_section(scene, pole):
    stem = pole(0.3, 0.0, 5.0)
    stand = scene(stem)
    trees = stand.detections()
    keypoints = trees.keypoints_px.copy()
    keypoints[:, 0] = 0.0
    unseen = replace(trees, keypoints_px=keypoints)
    (tree,) = measure_trees(unseen, stand.depth_m, stand.camera, up_camera=stand.up)
    assert isinstance(tree.cut_point_m, Failure)
    height_m = (tree.axis.point_m - stand.axis_point(stem, 0.0)) @ stand.along(stem)
    assert height_m == pytest.approx(stem.section_m, abs=0.1)


def test_axis_is_no_part_of_the_record(scene, pole):
    tree = scene(pole()).measure()
    assert not any("axis" in key and "distance" not in key for key in tree.to_dict())
    assert TreeMeasurement.failed("no depth on the stem").axis == Failure("no depth on the stem")
