"""A second stem in the mask of the one that is meant is left out, or nothing is given."""

from dataclasses import replace

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree.measure import Estimate, Failure

CAMERA = PinholeCamera(848, 480, 520.0, 520.0, 423.5, 239.5)
SEVERAL = "more than one stem"


def warned(tree):
    return any(SEVERAL in each for each in tree.evidence.warnings)


def measured(stand, seed, mask=None):
    """Measure what a mask shows of noisy depth, by default all stems in one."""
    mask = stand.owner > 0 if mask is None else mask
    depth_m = stand.noisy_depth_m(seed, 0.001)
    trees = stand.detections([mask] * len(stand.poles)).select([0])
    trees = replace(trees, keypoints_px=None, masks=None)
    return stand.measure(trees, depth_m=depth_m, masks=[mask], level=True, settings=None)


def two(scene, pole, seed, further, apart):
    """A stem, and one `further` times as far away, `apart` diameters beside it in the picture."""
    rng = np.random.default_rng(seed)
    near = pole(rng.uniform(0.2, 0.5), rng.uniform(-2.5, 2.5), rng.uniform(3.5, 6.0), top_m=9.0)
    side = rng.choice([-1, 1])
    far = pole(
        near.diameter_m * rng.uniform(0.8, 1.4),
        (near.right_m + side * apart * near.diameter_m) * further,
        near.ahead_m * further,
        top_m=12.0,
    )
    return near, scene(near, far, camera=CAMERA, camera_height_m=1.8)


@pytest.mark.parametrize("seed", range(1000, 1006))
@pytest.mark.parametrize(("further", "apart"), [(1.15, 1.0), (1.3, 0.7), (1.6, 0.6)])
def test_of_two_stems_the_nearer_one_is_measured(scene, pole, seed, further, apart):
    near, stand = two(scene, pole, seed, further, apart)
    tree = measured(stand, seed)
    if not tree.diameter_m:
        # Nothing tells which one is meant.
        assert further < 1.3
        assert SEVERAL in tree.diameter_m.reason
        return
    assert tree.diameter_m.value == pytest.approx(near.diameter_m, rel=0.15)
    for value, true in (
        (tree.diameter_m, near.diameter_m),
        (tree.axis_distance_m, np.hypot(near.right_m, near.ahead_m)),
        (tree.inclination_deg, 0.0),
    ):
        assert abs(value.value - true) < 3 * value.std


@pytest.mark.parametrize("seed", range(1000, 1004))
@pytest.mark.parametrize("number", [0, 1])
def test_keypoints_on_the_axis_tell_which_one_is_meant(scene, pole, seed, number):
    """Those of the further stem, whose section is not seen: the nearer one is not taken for it."""
    near, stand = two(scene, pole, seed, 1.4, 1.0)
    mask = stand.owner > 0
    trees = stand.detections([mask] * 2).select([number])
    points = trees.keypoints_px.copy()
    points[:, :3, 2] = 0.0
    trees = replace(trees, keypoints_px=points, masks=None)
    depth_m = stand.noisy_depth_m(seed, 0.001)
    tree = stand.measure(trees, depth_m=depth_m, masks=[mask], level=True, settings=None)
    if number == 1:
        assert SEVERAL in tree.axis_distance_m.reason
    else:
        assert tree.axis_distance_m.value == pytest.approx(
            np.hypot(near.right_m, near.ahead_m), abs=0.1
        )


def test_a_second_stem_is_said(scene, pole):
    trees = [measured(two(scene, pole, seed, 1.3, 0.7)[1], seed) for seed in range(1000, 1006)]
    assert sum(map(warned, trees)) >= 5


@pytest.mark.parametrize("seed", range(1000, 1004))
def test_of_two_stems_at_the_same_distance_none_is_measured(scene, pole, seed):
    rng = np.random.default_rng(seed)
    size_m, ahead_m = rng.uniform(0.3, 0.5), rng.uniform(2.5, 4.0)
    poles = [pole(size_m, side * size_m * 0.52, ahead_m, top_m=6.0) for side in (-1, 1)]
    tree = measured(scene(*poles, camera=CAMERA), seed)
    assert isinstance(tree.diameter_m, Failure)
    assert SEVERAL in tree.diameter_m.reason


@pytest.mark.parametrize("further", [None, 3.0])
@pytest.mark.parametrize("seed", range(1000, 1004))
def test_between_two_stems_the_background_shows(scene, pole, seed, further):
    """Thick and thin ones in noisy depth, before the sky or before something far behind."""
    rng = np.random.default_rng(seed)
    thick_m, thin_m, ahead_m = rng.uniform(0.3, 0.4), rng.uniform(0.15, 0.2), rng.uniform(6.0, 8.0)
    apart_m = rng.uniform(0.65, 0.7) * (thick_m + thin_m)
    poles = [pole(thick_m, 0.0, ahead_m, top_m=6.0), pole(thin_m, apart_m, ahead_m, top_m=6.0)]
    stand = scene(*poles, camera=CAMERA, camera_height_m=1.8)
    if further is not None:
        stand.depth_m[stand.depth_m == 0] = further * ahead_m
    tree = measured(stand, seed)
    assert isinstance(tree.diameter_m, Failure)
    assert SEVERAL in tree.diameter_m.reason


@pytest.mark.parametrize("seed", range(1000, 1006))
def test_a_fork_is_measured_below_its_arms(scene, pole, seed):
    """Two stems that part upwards from one place, in one mask."""
    rng = np.random.default_rng(seed)
    place = {"right_m": rng.uniform(-1.5, 1.5), "ahead_m": rng.uniform(4.0, 6.0), "top_m": 7.0}
    trunk = pole(rng.uniform(0.25, 0.45), **place)
    arm = pole(0.9 * trunk.diameter_m, lean_deg=rng.uniform(14, 22), **place)
    # The axes cross 0.9 m above the ground.
    shift_m = -0.9 * np.tan(np.radians(arm.lean_deg))
    arm = pole(
        arm.diameter_m, place["right_m"] + shift_m, place["ahead_m"], arm.lean_deg, top_m=7.0
    )
    stand = scene(trunk, arm, camera=CAMERA, camera_height_m=1.8)
    rows = np.arange(CAMERA.height)[:, None]
    at = stand.axis_point(trunk, 0.9)
    below = rows >= CAMERA.fy * at[1] / at[2] + CAMERA.cy + 0.5
    mask = (stand.owner == 1) | ((stand.owner == 2) & ~below)
    stand.depth_m[(stand.owner == 2) & below] = 0
    tree = measured(stand, seed, mask)
    assert isinstance(tree.diameter_m, Estimate)
    assert abs(tree.diameter_m.value - trunk.diameter_m) < 3 * tree.diameter_m.std
    assert tree.diameter_m.value == pytest.approx(trunk.diameter_m, rel=0.2)
    assert tree.inclination_deg.value < 3 * tree.inclination_deg.std


@pytest.mark.parametrize("seed", range(1000, 1012))
def test_one_stem_is_not_taken_for_two(scene, pole, seed):
    """At the side of the picture, its depth along the optical axis is askew."""
    rng = np.random.default_rng(seed)
    ahead_m = rng.uniform(3.0, 8.0)
    right_m = rng.uniform(0.4, 0.7) * ahead_m * rng.choice([-1, 1])
    stem = pole(rng.uniform(0.15, 0.5), right_m, ahead_m, rng.uniform(0, 8), 0.0, top_m=8.0)
    stand = scene(stem, camera=CAMERA, camera_height_m=1.8)
    tree = measured(stand, seed)
    assert tree.diameter_m
    assert not warned(tree)


@pytest.mark.parametrize("seed", range(1000, 1004))
def test_brush_beside_the_stem_in_its_mask_is_no_nearer_stem(scene, pole, seed):
    """What goes on beside the mask at the same depth is not a stem, which ends at its edge."""
    rng = np.random.default_rng(seed)
    stem = pole(rng.uniform(0.3, 0.5), 0.0, rng.uniform(4.0, 6.0), top_m=8.0)
    stand = scene(stem, camera=CAMERA, camera_height_m=1.8)
    mask = stand.owner == 1
    columns = np.flatnonzero(mask.any(0))
    third = columns[0] + len(columns) // 3
    hedge = np.zeros_like(mask)
    hedge[:, third - 200 : third] = True
    stand.depth_m[hedge] = stem.ahead_m - 0.8
    tree = measured(stand, seed, mask)
    assert not warned(tree)
