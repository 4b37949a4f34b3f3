"""Close pictures of stems, whose masks show ground, plants or roots at the foot, or places beside.

The masks are those that networks draw in such pictures: they are made by hand here, with keypoints
that no network would trust.
"""

from dataclasses import replace

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree import TreeDetections
from edgetree.measure import TreeMeasurement

PORTRAIT = PinholeCamera(180, 240, 185.0, 185.0, 89.5, 119.5)
UNSEEN = 0.02


@pytest.fixture
def close(scene, pole, wall):
    """A stem of 44 cm 1.7 m away, with a hump of earth on the left of its foot."""
    hump = wall(right_m=-0.42, ahead_m=1.7, width_m=0.5, thickness_m=0.5, height_m=0.5)
    frame = scene(
        pole(0.44, 0.0, 1.7, top_m=5.0),
        camera=PORTRAIT,
        camera_height_m=0.9,
        pitch_deg=0.0,
        walls=(hump,),
    )
    # A time-of-flight camera of a phone sees up to two metres.
    frame.depth_m = np.where(frame.depth_m < 2.2, frame.depth_m, 0).astype(np.float32)
    return frame


def network(frame, mask: np.ndarray, *, lowest_px: float | None = None) -> TreeDetections:
    """What a network gives that sees no section: a coarse mask, and keypoints anywhere."""
    trees = frame.detections([mask])
    keypoints = trees.keypoints_px.copy()
    keypoints[..., 2] = UNSEEN
    keypoints[:, [0, 1, 2], 1] = 150.0
    keypoints[:, 1, 0], keypoints[:, 2, 0] = 60.0, 110.0
    boxes = trees.boxes_px.copy()
    if lowest_px is not None:  # then such keypoints count, wherever they are
        boxes[:, 3] = lowest_px
        keypoints[:, 1, 0], keypoints[:, 2, 0] = 20.0, 118.0
    return replace(trees, keypoints_px=keypoints, boxes_px=boxes, by_network=True)


def measured(frame, mask: np.ndarray, **options: float) -> TreeMeasurement:
    trees = network(frame, mask, **options)
    return frame.measure(trees, level=True, settings=None, rig_uncertainty=None)


def test_ground_at_the_foot_is_no_part_of_the_stem(close) -> None:
    mask = close.owner == 1
    mask[170:, 20:] = True
    mask[170:, 130:] = False
    tree = measured(close, mask)
    assert tree.diameter_m.value == pytest.approx(0.44, abs=0.015)
    assert tree.diameter_m.std < 0.03
    assert any("more than the stem" in text for text in tree.evidence.warnings)
    assert any("part that is seen" in text for text in tree.evidence.warnings)


def test_keypoints_that_are_not_seen_give_way_to_the_straight_part(close) -> None:
    mask = close.owner == 1
    mask[170:, 20:] = True
    mask[170:, 130:] = False
    tree = measured(close, mask, lowest_px=228.0)
    assert tree.diameter_m.value == pytest.approx(0.44, abs=0.015)


def test_places_beside_the_stem_without_depth_are_no_part_of_it(close) -> None:
    mask = close.owner == 1
    edge = np.argmax(mask[:140], axis=1)
    for row in range(25, 140):
        reach = int(8 + 30 * abs(np.sin(row / 9)))
        mask[row, max(edge[row] - reach, 0) : edge[row]] = True
    mask[150:, 10:] = True
    mask[150:, 128:] = False
    tree = measured(close, mask)
    assert tree.diameter_m.value == pytest.approx(0.44, abs=0.02)
    low_m, high_m = tree.diameter_m.interval95
    assert low_m < 0.44 < high_m


def test_a_straight_mask_stays_as_it_is(close, scene, pole) -> None:
    frame = scene(pole(0.44, 0.0, 1.7, top_m=5.0), camera=PORTRAIT, camera_height_m=2.5)
    tree = measured(frame, frame.owner == 1)
    assert not any("more than the stem" in text for text in tree.evidence.warnings)


def test_roots_of_a_lone_stem_are_no_ground(scene, pole) -> None:
    frame = scene(pole(0.44, 0.0, 2.0, top_m=5.0), camera=PORTRAIT, camera_height_m=2.0)
    stem = frame.owner == 1
    frame.depth_m = np.where(stem, frame.depth_m, 0).astype(np.float32)
    # A root to the left and one to the right of the lowest rows, which the mask leaves out.
    left, right = np.argmax(stem[-1]), 180 - np.argmax(stem[-1, ::-1])
    for row in range(215, 240):
        share = (row - 215) / 24
        frame.depth_m[row, left - 14 : left] = 1.9 - 0.3 * share
        frame.depth_m[row, right : right + 14] = 1.9 - 0.3 * share
    tree = measured(frame, stem)
    assert not tree.dbh_m
    assert tree.evidence.ground.startswith("no ground around the base")
    assert tree.diameter_m.value == pytest.approx(0.44, abs=0.02)
