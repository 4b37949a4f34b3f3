"""Depth of branches and netting in front of a stem is not taken for the stem's."""

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree.measure import Estimate, Failure

SMALL = PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)


def stem_and_depth(scene, pole, seed):
    rng = np.random.default_rng(seed)
    stem = pole(rng.uniform(0.2, 0.5), rng.uniform(-2, 2), rng.uniform(4, 9), top_m=9.0)
    stand = scene(stem, camera=SMALL, camera_height_m=1.8)
    return rng, stem, stand, stand.noisy_depth_m(seed)


@pytest.mark.parametrize("seed", range(1000, 1010))
def test_a_branch_across_a_stem_without_depth_gives_no_distance(scene, pole, seed):
    rng, stem, stand, depth_m = stem_and_depth(scene, pole, seed)
    depth_m[stand.owner == 1] = 0
    row = rng.integers(60, 200)
    depth_m[row : row + rng.integers(30, 50)] = stem.ahead_m * rng.uniform(0.2, 0.8)
    tree = stand.measure(depth_m=depth_m, settings=None)
    assert isinstance(tree.axis_distance_m, Failure)
    assert "branch" in tree.axis_distance_m.reason


@pytest.mark.parametrize("seed", range(1060, 1070))
def test_dense_bars_that_show_the_stem_behind_are_not_the_stem(scene, pole, seed):
    rng, stem, stand, depth_m = stem_and_depth(scene, pole, seed)
    bars = (np.mgrid[:360, :640][0] % 10) < 9
    net_m = stem.ahead_m - rng.uniform(1.5, 2.5)
    depth_m[bars & ((depth_m > net_m) | (depth_m == 0))] = net_m
    distance = stand.measure(depth_m=depth_m, settings=None).axis_distance_m
    true_m = np.hypot(stem.right_m, stem.ahead_m)
    assert not distance or abs(distance.value - true_m) < 3 * distance.std
    assert distance or "netting" in distance.reason


@pytest.mark.parametrize("seed", range(1010, 1020))
def test_netting_in_front_of_a_stem_does_not_move_it(scene, pole, seed):
    rng, stem, stand, depth_m = stem_and_depth(scene, pole, seed)
    rows, columns = np.mgrid[:360, :640]
    wires = (rows % 11 < 3) | (columns % 11 < 3)
    net_m = stem.ahead_m - rng.uniform(0.7, 2.0)
    wires &= depth_m > net_m
    depth_m[wires] = net_m
    tree = stand.measure(depth_m=depth_m, settings=None)
    assert isinstance(tree.axis_distance_m, Estimate)
    true_m = np.hypot(stem.right_m, stem.ahead_m)
    assert abs(tree.axis_distance_m.value - true_m) < 2 * tree.axis_distance_m.std
    assert tree.inclination_deg.value < 3 * tree.inclination_deg.std
