"""The cut is just above the root flare and obstacles at the foot."""

import dataclasses

import numpy as np
import pytest

from perceptree.simulator.scene.description import describe_scene
from perceptree.simulator.scene.felling_cut import cut_height_m, is_near_foot
from perceptree.simulator.scene.models import MODELS
from perceptree.simulator.scene.stem import Stem, random_stem
from perceptree.simulator.settings.presets import PRESETS


def stem(seed: int, diameter_m: float = 0.3) -> Stem:
    rng = np.random.default_rng(seed)
    return random_stem(rng, MODELS[seed % len(MODELS)], diameter_m, 3.0, 20.0, 0.0)


def swelling(grown: Stem, height_m: float) -> float:
    """Widening of the section against the same stem without root collar."""
    bare = dataclasses.replace(
        grown, roots=np.array([[0.0, 0.0, 0.0, 1.0]]), bumps=np.zeros((1, 4))
    )
    angle, level = np.linspace(0, 2 * np.pi, 721)[:-1], np.array([height_m])
    flared = dataclasses.replace(grown, bumps=np.zeros((1, 4)))
    return float(flared.radius_m(level, angle).mean() / bare.radius_m(level, angle).mean()) - 1


@pytest.mark.parametrize("seed", range(18))
def test_the_stem_is_slim_at_the_cut_and_swollen_just_below(seed: int):
    grown = stem(seed)
    cut_m = cut_height_m(grown, 0.0)
    assert 0.05 <= cut_m <= 0.5
    assert swelling(grown, cut_m) <= 0.0801 or cut_m == 0.5
    if cut_m > 0.05:
        assert swelling(grown, cut_m - 0.011) > 0.08


def test_a_thick_stem_with_a_wide_flare_is_cut_higher():
    thin, thick = (cut_height_m(stem(3, diameter), 0.0) for diameter in (0.1, 0.6))
    assert thick > thin


def test_on_a_slope_the_flare_on_the_uphill_side_is_lower():
    grown = stem(11, 0.5)
    assert cut_height_m(grown, 0.15) <= cut_height_m(grown, 0.0) - 0.1


def test_a_stone_at_the_foot_lifts_the_cut_above_it_but_not_over_half_a_metre():
    grown = stem(6, 0.1)
    assert cut_height_m(grown, 0.0, [0.31, 0.2]) == pytest.approx(0.34)
    assert cut_height_m(grown, 0.0, [2.0]) == 0.5


def test_only_what_stands_against_the_bark_stands_at_the_foot():
    positions = np.array([[0.5, 0.0], [0.9, 0.0], [0.0, -0.3]])
    near = is_near_foot(np.zeros(2), 0.15, positions, np.array([0.22, 0.22, 0.1]))
    assert near.tolist() == [True, False, True]


def test_every_near_tree_of_the_field_has_its_diameter_points_above_its_own_cut():
    scene = describe_scene(PRESETS["field"].settings, 3_000_001)
    cuts_m = [tree.cut_height_m for tree in scene.near_trees]
    assert len(set(cuts_m)) > 5
    for tree in scene.near_trees:
        assert 0.05 <= tree.cut_height_m <= 0.5
        assert tree.diameter_height_m == pytest.approx(tree.cut_height_m + 0.1)


def test_the_older_presets_cut_every_tree_at_20_cm():
    scene = describe_scene(PRESETS["paper"].settings, 1_000_001)
    assert {tree.cut_height_m for tree in scene.trees} == {0.20}
    assert {tree.diameter_height_m for tree in scene.trees} == {0.30}
