"""Depth pictures that show stems and no ground."""

from __future__ import annotations

import numpy as np
import pytest
from stems_without_ground import COLUMNS, ROWS, STEMS, ground_m

from edgetree import TreeDetector, default_model, sample_frames
from edgetree.runtime.drawn_ground import with_ground


def test_a_plane_is_drawn_through_the_feet() -> None:
    drawn = with_ground(STEMS)

    assert drawn is not None
    np.testing.assert_array_equal(drawn[STEMS > 0], STEMS[STEMS > 0])
    near = (ground_m() > 0) & (ground_m() < 10) & (STEMS == 0)
    off = np.abs(drawn[near] / ground_m()[near] - 1)
    assert np.median(off) < 0.15


def test_branches_and_a_crown_above_the_ground_do_not_lift_it() -> None:
    depth_m = STEMS.copy()
    depth_m[:150, 300:390] = 7.0
    depth_m[200:206, 100:180] = 4.0

    drawn = with_ground(depth_m)

    assert drawn is not None
    near = (ground_m() > 0) & (ground_m() < 10) & (depth_m == 0)
    assert np.median(np.abs(drawn[near] / ground_m()[near] - 1)) < 0.2


@pytest.mark.parametrize("holes", [0.0, 0.5])
def test_ground_that_is_seen_is_left_alone(holes: float) -> None:
    depth_m = np.where(STEMS > 0, STEMS, ground_m())
    depth_m[np.random.default_rng(0).random(depth_m.shape) < holes] = 0

    assert with_ground(depth_m.astype(np.float32)) is None


def test_nothing_is_drawn_where_no_foot_is_seen() -> None:
    assert with_ground(np.zeros((ROWS, COLUMNS), np.float32)) is None
    assert with_ground(np.full((ROWS, COLUMNS), np.nan, np.float32)) is None
    cut = np.zeros((ROWS, COLUMNS), np.float32)
    cut[:, 300:360] = 2.0
    assert with_ground(cut) is None


def test_the_packaged_model_finds_stems_whose_ground_has_been_removed() -> None:
    detector = TreeDetector.load(default_model("depth"), threads=1)
    found = bare = 0
    for sample in sample_frames()[:3]:
        depth_m = sample.depth_m()
        trees = detector.detect(depth_m)
        stems = np.any([trees.mask(index) for index in range(len(trees))], axis=0)
        found += len(trees)
        bare += len(detector.detect(np.where(stems, depth_m, 0).astype(np.float32)))

    assert bare >= 0.8 * found


def test_trees_of_both_pictures_are_given_once_and_by_score() -> None:
    detector = TreeDetector.load(default_model("depth"), threads=1)

    trees = detector.detect_batch([STEMS, STEMS])

    for each in trees:
        assert (np.diff(each.scores) <= 0).all()
        middles = np.sort(each.boxes_px[:, [0, 2]].mean(1))
        assert (np.diff(middles) > 20).all()
    np.testing.assert_array_equal(trees[0].boxes_px, trees[1].boxes_px)
