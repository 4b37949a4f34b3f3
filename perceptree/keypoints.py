"""The keypoints of a tree, in the order of labels and of the network's outputs."""

KEYPOINT_NAMES = ("felling_cut", "diameter_left", "diameter_right", "axis_middle", "axis_top")
KEYPOINT_FLIP_PAIRS = ((1, 2),)
"""Keypoints, by index, that change places in a mirrored image."""
