"""Stems whose foot is below the image: no ground by branches, and a doubt about the diameter."""

from dataclasses import replace

import numpy as np
import pytest

from calib import pixels_to_rays
from edgetree.measure import Failure

CUT, LEFT, RIGHT = range(3)


@pytest.fixture(scope="module")
def footless(scene, pole):
    """A stem 3 m away whose lower 0.3 m are below the image."""
    return scene(pole(0.3, 0.0, 3.0, top_m=6.0), camera_height_m=1.8, pitch_deg=0.0)


def with_branches(stand, height_m, slope_deg):
    """Depth of the stem and of a sloping sheet of branches beside it, and of nothing else."""
    rows, columns = np.indices(stand.depth_m.shape)
    rays = pixels_to_rays(stand.camera, np.stack([columns, rows], -1) + 0.5)
    tangent = np.tan(np.radians(slope_deg))
    # The sheet rises to the right. At the stem, 3 m ahead, it is `height_m` above the ground.
    down_m = stand.camera_height_m - height_m
    falling = rays @ -stand.up + tangent * rays[..., 0]
    z_m = np.where(falling > 0.05, down_m / np.maximum(falling, 0.05), 0.0)
    near = (np.abs(z_m - 3.0) < 1.3) & (np.abs(rays[..., 0] * z_m) < 1.2)
    return np.where(stand.owner == 1, stand.depth_m, near * z_m).astype(np.float32)


def measured(stand, depth_m=None, trees=None):
    masks = stand.masks()
    depth_m = stand.depth_m if depth_m is None else depth_m
    trees = stand.detections() if trees is None else trees
    return stand.measure(trees, depth_m, masks=masks, settings=None)


def test_ground_behind_the_stem_tells_breast_height(footless):
    tree = measured(footless)
    assert tree.dbh_m.value == pytest.approx(0.3, rel=0.03)
    assert tree.cut_height_m.reason == "the felling cut is not in the image"


def test_steep_branches_are_no_ground_of_a_stem_without_a_foot(footless):
    tree = measured(footless, with_branches(footless, 0.6, 38.0))
    assert isinstance(tree.dbh_m, Failure)
    assert "the foot of the stem is not in the image" in tree.dbh_m.reason
    assert "slopes by 38 degrees" in tree.dbh_m.reason
    assert tree.diameter_m


def test_level_branches_are_no_ground_as_the_cut_would_be_in_the_image(footless):
    low, high = (with_branches(footless, height_m, 0.0) for height_m in (0.6, 0.75))
    stripes = np.indices(low.shape)[1] % 40 < 16
    twigs = (footless.owner != 1) & stripes & (high > 0)
    tree = measured(footless, np.where(twigs, high, low))
    assert isinstance(tree.dbh_m, Failure)
    assert "the foot of the stem is not in the image" in tree.dbh_m.reason
    assert tree.dbh_m.reason.endswith("m below what is seen of it")
    assert tree.profile.heights_from == "section"
    assert tree.diameter_m


def test_no_ground_lies_above_the_lowest_part_of_the_stem_that_is_seen(footless):
    tree = measured(footless, with_branches(footless, 1.0, 0.0))
    assert isinstance(tree.dbh_m, Failure)
    assert "the stem is seen 0." in tree.dbh_m.reason
    assert tree.dbh_m.reason.endswith("m below the best plane")


def test_the_foot_of_a_whole_stem_without_keypoints_is_in_the_image(scene, pole):
    stand = scene(
        pole(0.3, 0.0, 4.0), camera_height_m=2.5, pitch_deg=25.0, slope_deg=35.0, uphill_deg=0.0
    )
    tree = stand.measure_mask(settings=None)
    assert tree.dbh_m.value == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize(("above_px", "share"), [(5.0, 0.07), (40.0, 0.042), (150.0, 0.0)])
def test_a_section_at_the_lower_side_may_be_that_of_the_butt(footless, above_px, share):
    """Networks predict the keypoints of a section below the image at its lower side."""
    trees = footless.detections()
    keypoints = trees.keypoints_px.copy()
    height = footless.camera.height
    left, right = np.flatnonzero((footless.owner == 1)[-1])[[0, -1]] + (0, 1)
    keypoints[0, CUT, :2] = (left + right) / 2, height - 2
    keypoints[0, LEFT, :2] = left, height - above_px
    keypoints[0, RIGHT, :2] = right, height - above_px
    tree = measured(footless, trees=replace(trees, keypoints_px=keypoints))
    assert tree.diameter_m.value == pytest.approx(0.3 * (1 + share), rel=0.01)
    doubt = "the cut may be below the picture: its diameter is in part inferred"
    assert (doubt in tree.evidence.warnings) == (share > 0)
    if share == 0.07:
        low_m, high_m = tree.diameter_m.interval95
        assert low_m < 0.3 < 0.3 * 1.14 < high_m
