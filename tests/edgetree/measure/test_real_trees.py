"""Diameters of real trees, by a time-of-flight camera, against a tape around their stems.

Where the captures are missing, simulated captures of the same kind stand in: masks from the depth
map alone, and a mask drawn by hand over depth from another camera.
"""

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
    """(H, W) bool mask of the largest connected component with readings: the measured tree."""
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


def test_simulated_stems_are_as_thick_as_they_are(scene, pole) -> None:
    """One stem a frame by a coarse and noisy depth camera; its mask is what stands out in depth."""
    camera = PinholeCamera(240, 180, 210.0, 210.0, 119.5, 89.5)
    measured_m, true_m, within = [], [], []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        diameter_m, ahead_m = rng.uniform(0.12, 0.5), rng.uniform(1.0, 2.0)
        stem = pole(diameter_m, rng.uniform(-0.2, 0.2), ahead_m, lean_deg=rng.uniform(0, 5))
        stand = scene(stem, camera=camera, camera_height_m=1.3, pitch_deg=0.0)
        noise_m = rng.normal(0, 0.008, stand.depth_m.shape)
        near = (stand.depth_m > 0) & (stand.depth_m < ahead_m + 0.3)
        depth_m = np.where(near & (stand.owner == 1), stand.depth_m + noise_m, 0)
        tree = stand.measure_mask(
            largest_part(depth_m), depth_m=depth_m.astype(np.float32), level=True, settings=None
        )
        assert tree.diameter_m, (seed, tree.diameter_m)
        measured_m.append(tree.diameter_m.value)
        true_m.append(diameter_m)
        low_m, high_m = tree.diameter_m.interval95
        within.append(low_m < diameter_m < high_m)
    errors_m = np.array(measured_m) - true_m
    assert np.sqrt(np.mean(errors_m**2)) < 0.025
    assert np.mean(np.abs(errors_m) / true_m) < 0.06
    assert np.mean(within) > 0.9


def test_a_stem_drawn_by_hand_over_depth_from_another_camera(scene, pole) -> None:
    stem = pole(0.3, 0.2, 4.0)
    colour = scene(stem)
    depth = scene(stem, camera=PinholeCamera(320, 240, 210.0, 210.0, 159.5, 119.5))
    registered_m = register_depth(
        depth.depth_m, depth.camera, colour.camera, RigidTransform.identity()
    )
    rows = np.flatnonzero((colour.owner == 1).any(axis=1))[[20, -20]]
    left, right = ([np.flatnonzero(colour.owner[y] == 1)[side] for y in rows] for side in (0, -1))
    corners = [(left[0], rows[0]), (right[0], rows[0]), (right[1], rows[1]), (left[1], rows[1])]
    mask = np.zeros(colour.owner.shape, np.uint8)
    cv2.fillPoly(mask, [np.array(corners, np.int32)], [1])
    tree = colour.measure_mask(mask > 0, depth_m=registered_m, level=True, settings=None)
    assert tree.diameter_m.value == pytest.approx(0.3, abs=0.015)
    assert tree.distance_m
