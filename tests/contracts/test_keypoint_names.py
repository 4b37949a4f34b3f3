"""The runtime names the same five keypoints as the trainer, without importing it."""

import edgetree
from perceptree.keypoints import KEYPOINT_NAMES


def test_runtime_and_trainer_name_the_same_keypoints_in_the_same_order():
    assert tuple(edgetree.KEYPOINT_NAMES) == KEYPOINT_NAMES
