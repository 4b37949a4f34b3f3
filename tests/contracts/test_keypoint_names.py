"""Simulator, models and runtime import nothing of each other, and name the same five keypoints."""

import edgetree
import perceptree.models
from perceptree.simulator.labelling import annotate


def test_all_three_houses_name_the_same_keypoints_in_the_same_order():
    assert annotate.KEYPOINT_NAMES == perceptree.models.KEYPOINT_NAMES
    assert tuple(edgetree.KEYPOINT_NAMES) == perceptree.models.KEYPOINT_NAMES
