"""Stems behind a nearer stem, and stations that show one edge."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from edgetree.measure import EXACT_RIG, Failure, measure_trees


def measured(stand, depth_m, masks, keypoints=True):
    trees = replace(stand.detections(masks), masks=None)
    trees = trees if keypoints else replace(trees, keypoints_px=None)
    return measure_trees(
        trees,
        depth_m,
        stand.camera,
        masks=masks,
        up_camera=stand.up,
        rig_uncertainty=EXACT_RIG,
    )


def test_stems_that_touch_at_the_same_distance_keep_their_depth(scene, pole):
    stand = scene(pole(0.3, -0.15, 4.0), pole(0.3, 0.15, 4.0))
    for tree in measured(stand, stand.depth_m, stand.masks()):
        assert tree.diameter_m.value == pytest.approx(0.3, rel=0.05)
        assert tree.distance_m


def test_depth_that_grows_from_a_nearer_stem_is_not_that_of_the_one_behind(scene, pole):
    """Most of what shows of the one behind has the depth of the nearer one, but not all."""
    stand = scene(pole(0.3, 0.0, 3.0), pole(0.4, 0.42, 8.0))
    near, shown = stand.masks()
    grown = cv2.dilate(near.astype(np.uint8), np.ones((1, 13), np.uint8)).astype(bool) & shown
    depth_m = np.where(grown, 2.85, stand.depth_m).astype(np.float32)
    before, behind = measured(stand, depth_m, [near, shown])
    assert before.diameter_m.value == pytest.approx(0.3, rel=0.05)
    assert behind.axis_distance_m.value == pytest.approx(8.0, rel=0.05)
    assert behind.diameter_m.value == pytest.approx(0.4, rel=0.05)


def test_depth_of_which_hardly_any_agrees_is_not_that_of_a_stem(scene, pole):
    """As between a near stem and the background, where stereo cameras mix both."""
    stand = scene(pole(0.3, 0.0, 6.0))
    mask = stand.masks()[0]
    mixed_m = 1 / np.random.default_rng(3).uniform(1 / 9, 1 / 2, mask.shape)
    depth_m = np.where(mask, mixed_m, stand.depth_m).astype(np.float32)
    tree = measured(stand, depth_m, [mask])[0]
    assert "does not agree with itself" in tree.distance_m.reason


def test_an_edge_behind_a_nearer_stem_is_hidden_where_nothing_is_read_too(scene, pole):
    """Stereo cameras read nothing along one side of a near stem."""
    stand = scene(pole(0.3, 0.0, 2.0), pole(0.3, 0.2, 4.0))
    near, half = stand.masks()
    depth_m = stand.depth_m.copy()
    rows = np.arange(len(depth_m))[:, None] % 40 < 20
    band = cv2.dilate(half.astype(np.uint8), np.ones((1, 61), np.uint8)).astype(bool) & ~half
    depth_m[band & rows] = 0.0
    tree = measured(stand, depth_m, [near, half], keypoints=False)[1]
    assert isinstance(tree.diameter_m, Failure)


def test_stations_with_one_edge_have_the_height_of_that_edge(scene, pole):
    """Something hides the left edge of the lower half: the diameters above are where they were."""
    stand = scene(pole(0.3, 0.3, 4.0, taper=0.03, top_m=4.0))
    mask = stand.masks()[0]
    whole, (tree,) = measured(stand, stand.depth_m, [mask])[0], measured(*_left_hidden(stand))
    rows = zip(whole.profile.height_m.tolist(), whole.profile.diameter_m.tolist(), strict=True)
    known = {round(height, 1): diameter for height, diameter in rows}
    heights, values = tree.profile.height_m.tolist(), tree.profile.diameter_m.tolist()
    assert len(heights) > 5
    for height, value in zip(heights, values, strict=True):
        assert value == pytest.approx(known[round(height, 1)], rel=0.03)
    hidden_m = min(heights)
    assert hidden_m > min(whole.profile.height_m) + 0.3


def _left_hidden(stand):
    """The scene with something 1 m ahead over the left third of the lower half of the stem."""
    mask = stand.masks()[0]
    rows = np.flatnonzero(mask.any(1))
    middle = np.array([np.flatnonzero(mask[row]).mean() for row in rows])
    columns, cover = np.arange(mask.shape[1]), np.zeros_like(mask)
    for row, centre in zip(rows[len(rows) // 2 :], middle[len(rows) // 2 :], strict=True):
        cover[row] = (columns < centre - 5) & (columns > centre - 80)
    depth_m = np.where(cover, 1.0, stand.depth_m).astype(np.float32)
    return stand, depth_m, [mask & ~cover]
