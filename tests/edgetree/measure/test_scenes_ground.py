"""Even plants that hide the soil, and stems by a mask alone whose foot is in view."""

from dataclasses import replace

import numpy as np
import pytest

from basetree.errors import InputError
from calib import PinholeCamera
from edgetree.measure import Failure, MeasureSettings
from edgetree.measure.estimates import Estimate
from edgetree.measure.even_cover import above_soil, hidden_std_m

CAMERA = PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)


@pytest.fixture(scope="module")
def stand(scene, pole, grass):
    """Build a scene of one stem by a seed; `share` of the ground has plants with an even top."""

    def build(seed, share=0.0):
        rng = np.random.default_rng(seed)
        diameter_m, cut_m = rng.uniform(0.18, 0.45), rng.uniform(0.1, 0.4)
        stem = pole(
            diameter_m,
            rng.uniform(-0.6, 0.6),
            rng.uniform(3.2, 6.0),
            lean_deg=rng.uniform(0, 4),
            lean_towards_deg=rng.uniform(0, 360),
            cut_m=cut_m,
            section_m=cut_m + 0.15,
            top_m=4.0,
            taper=0.07 * diameter_m,
        )
        plants = grass(rng.uniform(0.15, 0.4), share, rng.choice([0.04, 0.1, 0.2]), 0.94, seed)
        return scene(
            stem,
            camera=CAMERA,
            camera_height_m=rng.uniform(1.8, 2.7),
            pitch_deg=rng.uniform(12, 24),
            slope_deg=rng.choice([0.0, 7.0, 14.0]),
            uphill_deg=rng.uniform(0, 360),
            grass=plants if share else None,
        )

    return build


def by_keypoints(stand, seed):
    [mask] = stand.masks()
    depth_m = stand.noisy_depth_m(seed)
    return stand.measure(stand.detections([mask]), depth_m, masks=[mask], settings=None)


def by_mask(stand, seed, mask=None):
    mask = stand.masks()[0] if mask is None else mask
    trees = replace(stand.detections([mask]), keypoints_px=None, masks=None)
    return stand.measure(trees, stand.noisy_depth_m(seed), masks=[mask], settings=None)


def test_even_plants_give_no_height_below_zero_and_few_sure_wrong_ones(stand):
    silent, given = 0, 0
    for seed in range(1000, 1016):
        there = stand(seed, share=(0.9, 1.0)[seed % 2])
        tree = by_keypoints(there, seed)
        if isinstance(tree.cut_height_m, Failure):
            continue
        height, true_m = tree.cut_height_m, there.cut_height_m(there.poles[0])
        given += 1
        assert height.value > 0
        warned = any("may hide" in text or "hide the" in text for text in tree.evidence.warnings)
        silent += abs(height.value - true_m) > 3 * height.std and not warned
    assert given > 4
    assert silent <= 1


def test_heights_count_from_the_ground_below_a_stated_cover(scene, pole, grass):
    stated = MeasureSettings(ground_cover_m=0.3, ground_cover_std_m=0.04)
    for seed in range(1040, 1046):
        there = scene(
            pole(0.3, 0.0, 4.5, cut_m=0.4, section_m=0.55),
            camera=CAMERA,
            camera_height_m=2.2,
            pitch_deg=18.0,
            grass=grass(0.3, 1.0, 0.1, 0.94, seed),
        )
        [mask] = there.masks()
        trees, depth_m = there.detections([mask]), there.noisy_depth_m(seed)
        blind, told = (
            there.measure(trees, depth_m, masks=[mask], settings=settings)
            for settings in (None, stated)
        )
        true_m = there.cut_height_m(there.poles[0])
        assert told.cut_height_m.value == pytest.approx(true_m, abs=0.08)
        low_m, high_m = told.cut_height_m.interval95
        assert low_m < true_m < high_m
        assert not blind.cut_height_m or blind.cut_height_m.value < true_m - 0.2
        assert "below a cover of 0.30 ± 0.04 m" in told.evidence.ground
        assert not any("even top" in text for text in told.evidence.warnings)


@pytest.mark.parametrize("name", ["ground_cover_m", "ground_cover_std_m"])
def test_a_cover_below_zero_is_refused(name):
    with pytest.raises(InputError, match=f"{name} is -0.1: expected"):
        MeasureSettings(**{name: -0.1})


def test_heights_on_bare_ground_stay(stand):
    for seed in range(1020, 1032):
        there = stand(seed)
        height, true_m = by_keypoints(there, seed).cut_height_m, there.cut_height_m(there.poles[0])
        assert height.value == pytest.approx(true_m, abs=0.03)
        low_m, high_m = height.interval95
        assert low_m < true_m < high_m


def test_the_lower_a_cut_comes_out_the_less_is_known_of_the_soil():
    stds_m = [hidden_std_m(height_m) for height_m in (0.03, 0.06, 0.12, 0.25)]
    assert np.all(np.diff(stds_m) < 0)
    assert stds_m[0] > 0.1
    assert stds_m[-1] < 0.04
    below, above = above_soil(Estimate(-0.04, 0.05)), above_soil(Estimate(0.3, 0.05))
    assert below.value > 0
    assert above.value == pytest.approx(0.3, abs=1e-6)
    assert below.std > 0.1


def test_gaps_between_plants_and_bark_below_the_plane_make_heights_doubtful(scene, pole):
    there = scene(pole(0.3, 0.0, 4.0), camera=CAMERA, camera_height_m=2.3, pitch_deg=22.0)
    bare = by_keypoints(there, 1).cut_height_m
    deeper = there.noisy_depth_m(1).copy()
    foot = np.flatnonzero((there.owner == 1).any(1))[-1]
    columns = np.flatnonzero((there.owner == 1)[foot - 2])
    right = columns[-1] + 4
    deeper[foot - 15 : foot + 15, right : right + 12] *= 1.06
    [mask] = there.masks()
    gaps = there.measure(there.detections([mask]), deeper, masks=[mask], settings=None)
    assert not gaps.cut_height_m or gaps.cut_height_m.std > 1.5 * bare.std
    longer = mask.copy()
    longer[foot : foot + 18, columns] = True
    depth_m = np.where(longer & ~mask, there.depth_m[foot - 2, columns[0]], there.depth_m)
    stem = there.measure(
        there.detections([longer]), depth_m.astype(np.float32), masks=[longer], settings=None
    )
    assert not stem.cut_height_m or stem.cut_height_m.std > 1.5 * bare.std


def test_a_mask_alone_finds_the_ground_at_its_foot_and_names_its_place(stand):
    for seed in range(1040, 1052):
        there = stand(seed)
        tree = by_mask(there, seed)
        assert tree.dbh_m
        true_m = np.linalg.norm(there.foot(there.poles[0]))
        assert abs(tree.distance_m.value - true_m) < 3 * tree.distance_m.std
        assert tree.evidence.distance_at == "lowest seen part of the stem"


def test_one_pixel_of_noise_in_a_mask_moves_its_distance_little(stand):
    for seed in range(1060, 1066):
        there, rng = stand(seed), np.random.default_rng(seed)
        [mask] = there.masks()
        values_m = [by_mask(there, seed).distance_m.value]
        for _ in range(3):
            noisy = mask.copy()
            for shift, axis in ((1, 0), (-1, 0), (1, 1), (-1, 1)):
                noisy |= np.roll(mask, shift, axis) & (rng.random(mask.shape) < 0.4)
            values_m.append(by_mask(there, seed, noisy).distance_m.value)
        assert np.ptp(values_m) < 0.08
