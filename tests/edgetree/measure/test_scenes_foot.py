"""Depth that contradicts the place where the foot meets the ground is in doubt, with a warning."""

from dataclasses import replace

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree.measure import Failure, measure_trees

SMALL = PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)


def frame(scene, pole, seed, ahead_m, count=1):
    """Stems, and the depth of a moment at which they were `ahead_m` further away."""
    rng = np.random.default_rng(seed)
    places = 1.6 * (np.arange(count) - (count - 1) / 2)
    stems = [pole(rng.uniform(0.2, 0.4), x, rng.uniform(4.5, 7.5), top_m=9.0) for x in places]
    moved = [replace(stem, ahead_m=stem.ahead_m + ahead_m) for stem in stems]
    now, then = (scene(*each, camera=SMALL, camera_height_m=1.8) for each in (stems, moved))
    return now, then.noisy_depth_m(seed)


def measured(now, depth_m, number=0):
    trees = measure_trees(
        now.detections(), depth_m, now.camera, masks=now.masks(), up_camera=now.up
    )
    stem = now.poles[number]
    return trees[number], float(np.hypot(stem.right_m, stem.ahead_m))


def feet(tree):
    return [text for text in tree.evidence.warnings if "the ground" in text and "depth" in text]


@pytest.mark.parametrize("seed", range(1000, 1008))
@pytest.mark.parametrize("ahead_m", [0.4, 0.8])
def test_depth_of_an_earlier_moment_is_in_doubt(scene, pole, seed, ahead_m):
    tree, true_m = measured(*frame(scene, pole, seed, ahead_m))
    distance = tree.axis_distance_m
    assert distance.value - true_m > 0.6 * ahead_m
    assert distance.value - true_m < 2 * distance.std
    assert tree.diameter_m.std > 0.4 * ahead_m / true_m * tree.diameter_m.value
    assert ahead_m < 0.8 or "earlier moment" in feet(tree)[0]


@pytest.mark.parametrize("seed", range(1010, 1016))
def test_depth_of_this_moment_is_not(scene, pole, seed):
    tree, true_m = measured(*frame(scene, pole, seed, 0.0))
    assert feet(tree) == []
    assert tree.axis_distance_m.value == pytest.approx(true_m, abs=0.1)
    assert tree.axis_distance_m.std < 0.12


@pytest.mark.parametrize("seed", range(1060, 1068))
@pytest.mark.parametrize("back_m", [0.4, 0.7])
def test_depth_before_driving_back_is_in_doubt(scene, pole, seed, back_m):
    now, depth_m = frame(scene, pole, seed, -back_m, count=2)
    for number in (0, 1):
        tree, true_m = measured(now, depth_m, number)
        distance = tree.axis_distance_m
        if distance:
            assert abs(true_m - distance.value) < min(3 * distance.std, 0.8 * back_m)
            assert feet(tree)


@pytest.mark.parametrize("seed", range(1110, 1116))
@pytest.mark.parametrize("ahead_m", [-0.4, 0.4])
def test_distances_are_corrected_where_all_feet_tell_late_depth(scene, pole, seed, ahead_m):
    now, depth_m = frame(scene, pole, seed, ahead_m, count=3)
    found = [measured(now, depth_m, number) for number in range(3)]
    given = [(tree, true_m) for tree, true_m in found if tree.axis_distance_m]
    assert len(given) >= 2
    for tree, true_m in given:
        error_m = abs(tree.axis_distance_m.value - true_m)
        assert error_m < min(0.2, 3 * tree.axis_distance_m.std)
    assert sum("are corrected by" in feet(tree)[0] for tree, _ in given) >= 2


def test_a_mask_that_ends_too_early_puts_no_other_stem_in_doubt(scene, pole):
    now, depth_m = frame(scene, pole, 1070, 0.0, count=3)
    masks = now.masks()
    masks[1][np.flatnonzero(masks[1].any(1))[-20:]] = False
    trees = measure_trees(now.detections(), depth_m, now.camera, masks=masks, up_camera=now.up)
    for number in (0, 2):
        assert feet(trees[number]) == []
        assert trees[number].axis_distance_m.std < 0.12


def test_stems_without_a_foot_share_the_doubt_of_the_others(scene, pole):
    now, depth_m = frame(scene, pole, 1021, 0.6, count=3)
    # Something hides the depth below the middle stem, so that its foot is not seen.
    rows, columns = np.nonzero(now.masks()[1])
    depth_m[rows.max() - 5 : rows.max() + 40, columns.min() - 20 : columns.max() + 20] = 0
    tree, true_m = measured(now, depth_m, 1)
    assert tree.axis_distance_m.value - true_m < 2 * tree.axis_distance_m.std
    assert "feet of the stems" in feet(tree)[0]


def test_one_stem_with_other_depth_puts_no_other_in_doubt(scene, pole):
    now, depth_m = frame(scene, pole, 1030, 0.0, count=3)
    depth_m = np.where(now.masks()[1], depth_m + 0.9, depth_m).astype(np.float32)
    assert "earlier moment" in feet(measured(now, depth_m, 1)[0])[0]
    for number in (0, 2):
        assert feet(measured(now, depth_m, number)[0]) == []


def test_depth_in_front_of_the_foot_is_in_doubt_or_refused(scene, pole):
    now, depth_m = frame(scene, pole, 1040, 0.0)
    depth_m = np.where(now.masks()[0], depth_m - 1.2, depth_m).astype(np.float32)
    tree, true_m = measured(now, depth_m)
    assert true_m - tree.axis_distance_m.value < 2 * tree.axis_distance_m.std
    assert "something in front" in feet(tree)[0]


def test_depth_far_from_the_foot_is_refused(scene, pole):
    now, depth_m = frame(scene, pole, 1050, 0.0)
    depth_m = np.where(now.masks()[0], depth_m / 2, depth_m).astype(np.float32)
    tree, _ = measured(now, depth_m)
    assert isinstance(tree.axis_distance_m, Failure)
    assert "something in front" in tree.axis_distance_m.reason


@pytest.mark.parametrize("seed", range(1080, 1086))
def test_depth_of_a_nearer_stem_in_the_mask_is_in_doubt(scene, pole, seed):
    """Keypoints are on the further of two stems, and the nearer one fills most of its mask."""
    rng = np.random.default_rng(seed)
    ahead_m, size_m, side = rng.uniform(6.5, 7.5), rng.uniform(0.25, 0.35), rng.choice([-1, 1])
    nearer = pole(size_m, side * 0.4 * size_m, 0.65 * ahead_m, top_m=9.0)
    stand = scene(pole(size_m, 0.0, ahead_m, top_m=9.0), nearer, camera_height_m=1.8)
    mask = stand.owner > 0
    trees = stand.detections([mask, mask]).select([0])
    depth_m = stand.noisy_depth_m(seed)
    (tree,) = measure_trees(trees, depth_m, stand.camera, masks=[mask], up_camera=stand.up)
    off_m = tree.axis_distance_m.value - ahead_m
    assert off_m < -1.0
    assert abs(off_m) < 3 * tree.axis_distance_m.std
    assert any("in front of the stem" in each for each in tree.evidence.warnings)


@pytest.mark.parametrize("seed", range(1090, 1096))
def test_the_lean_is_in_doubt_where_the_foot_contradicts_the_depth(scene, pole, seed):
    """The depth is that of an arm that leans to the camera, with its foot behind the stem's."""
    rng = np.random.default_rng(seed)
    ahead_m, size_m = rng.uniform(5.0, 6.5), rng.uniform(0.25, 0.4)
    now = scene(pole(size_m, 0.0, ahead_m, top_m=6.0), camera_height_m=1.8)
    arm = pole(size_m, 0.0, ahead_m + 0.5, lean_deg=18.0, lean_towards_deg=-90.0, top_m=6.0)
    depth_m = scene(arm, camera_height_m=1.8).noisy_depth_m(seed)
    tree, _ = measured(now, depth_m)
    assert feet(tree)
    assert tree.inclination_deg.value > 10
    assert tree.inclination_deg.value < 3 * tree.inclination_deg.std
