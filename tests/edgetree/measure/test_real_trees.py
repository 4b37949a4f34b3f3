"""Diameters of real trees, by a time-of-flight camera, against a tape around their stems."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib import PinholeCamera, RigidTransform, read_depth, register_depth
from edgetree import TreeDetections
from edgetree.measure import measure_trees

# The outline of the straight stem in the colour picture, drawn by hand, px.
DRAWN = [
    (275, 0),
    (302, 0),
    (305, 60),
    (307, 120),
    (307, 240),
    (309, 420),
    (272, 420),
    (272, 240),
    (275, 120),
]


def largest_part(depth_m: np.ndarray) -> np.ndarray:
    """(H, W) bool the largest connected part with readings: the tree that was aimed at."""
    valid = (depth_m > 0).astype(np.uint8)
    closed = cv2.morphologyEx(valid, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(closed)
    return np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def test_stems_are_as_thick_as_the_tape_says(shared_path: Callable[[str], Path]) -> None:
    folder = shared_path("data/tof_trees")
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    camera = PinholeCamera(**truth["camera"])
    measured_m, tape_m, within = [], [], []
    for frame in truth["frames"]:
        depth_m = read_depth(folder / f"{frame['frame']}_depth_mm.png")
        mask = largest_part(depth_m)
        x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
        trees = TreeDetections(
            np.array([[x, y, x + width, y + height]], np.float32),
            np.ones(1, np.float32),
            None,
            None,
            camera.width,
            camera.height,
        )
        [tree] = measure_trees(trees, depth_m, camera, masks=[mask])
        assert tree.diameter_m, (frame["frame"], tree.diameter_m)
        measured_m.append(tree.diameter_m.value)
        tape_m.append(frame["diameter_m"])
        low_m, high_m = tree.diameter_m.interval95
        within.append(low_m < frame["diameter_m"] < high_m)
    errors_m = np.array(measured_m) - tape_m
    assert len(errors_m) >= 15
    assert np.sqrt(np.mean(errors_m**2)) < 0.025
    assert np.mean(np.abs(errors_m) / tape_m) < 0.06
    assert np.mean(within) > 0.9


def test_a_stem_drawn_by_hand_in_a_real_picture(shared_path: Callable[[str], Path]) -> None:
    folder = shared_path("data/forest_rgbd")
    known = json.loads((folder / "camera.json").read_text(encoding="utf-8"))
    size = ("width", "height", "fx", "fy", "cx", "cy")
    colour, depth = (PinholeCamera(*(known[k][name] for name in size)) for k in ("color", "depth"))
    depth_m = read_depth(folder / "depth_mm.png")
    registered_m = register_depth(depth_m, depth, colour, RigidTransform.identity())
    mask = np.zeros(registered_m.shape, np.uint8)
    cv2.fillPoly(mask, [np.array(DRAWN)], [1])
    box = np.array([[272, 0, 310, 421]], np.float32)
    trees = TreeDetections(box, np.ones(1, np.float32), None, None, colour.width, colour.height)
    [tree] = measure_trees(trees, registered_m, colour, masks=[mask > 0])
    assert tree.diameter_m.value == pytest.approx(known["truth"]["dbh_m"], abs=0.015)
    assert tree.distance_m
