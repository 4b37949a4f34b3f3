"""Heights where grass hides the ground, and where hedges or walls stand beside the stem."""

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree.measure import Failure


def measured(stand, seed=0):
    [mask] = stand.masks()
    trees = stand.detections([mask])
    return stand.measure(trees, stand.noisy_depth_m(seed), masks=[mask], settings=None)


@pytest.fixture(scope="module")
def meadow(scene, pole, grass):
    """Build a scene of one stem in grass of 0.3 m."""

    def build(cut_m=0.25, **options):
        stem = pole(0.3, 0.1, 4.0, cut_m=cut_m, section_m=cut_m + 0.15)
        return scene(stem, camera_height_m=2.5, pitch_deg=25.0, grass=grass(**options))

    return build


@pytest.mark.parametrize(("share", "column_m"), [(0.3, 0.1), (0.7, 0.35)])
def test_the_interval_holds_where_gaps_between_tufts_show_the_ground(meadow, share, column_m):
    stand = meadow(share=share, column_m=column_m)
    height = measured(stand).cut_height_m
    low_m, high_m = height.interval95
    assert low_m < stand.cut_height_m(stand.poles[0]) < high_m
    bare = measured(meadow(share=0.0)).cut_height_m
    assert bare.value == pytest.approx(0.25, abs=0.02)
    assert height.std > 1.2 * bare.std


def test_tufts_in_front_of_a_high_stump_do_not_hide_its_warning(meadow):
    tree = measured(meadow(cut_m=0.4, share=0.7, column_m=0.25))
    assert any("the stump" in warning for warning in tree.evidence.warnings)


def test_a_cut_below_closed_grass_has_no_height(meadow):
    tree = measured(meadow(cut_m=0.12, share=0.9, column_m=0.03, low=0.8))
    assert isinstance(tree.cut_height_m, Failure)
    assert tree.cut_height_m.reason.startswith("plants hide the ground: the felling cut is ")
    assert tree.distance_m


@pytest.mark.parametrize("slope_deg", [0.0, 15.0, 25.0])
@pytest.mark.parametrize("roughness_m", [0.0, 0.2])
def test_hedges_and_walls_do_not_carry_the_ground(scene, pole, wall, slope_deg, roughness_m):
    stem = pole(0.3, 0.1, 4.0)
    around = (
        wall(0.1, 4.6, roughness_m=roughness_m),
        wall(0.9, 4.0, turned_deg=90.0, roughness_m=roughness_m),
    )
    stand = scene(
        stem, camera_height_m=2.5, pitch_deg=25.0, slope_deg=slope_deg, uphill_deg=0.0, walls=around
    )
    height = measured(stand, seed=int(slope_deg)).cut_height_m
    assert np.isclose(height.value, stand.cut_height_m(stem), atol=0.03)


@pytest.fixture(scope="module")
def small_camera():
    return PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)


@pytest.mark.parametrize("slope_deg", [0.0, 15.0])
@pytest.mark.parametrize("column_m", [0.03, 0.06, 0.12])
@pytest.mark.parametrize("share", [0.7, 0.9])
def test_dense_grass_gives_no_sure_wrong_cut_height(
    scene, pole, grass, small_camera, share, column_m, slope_deg
):
    high = pole(0.3, 0.1, 4.5, cut_m=0.35, section_m=0.5)
    stand = scene(
        high,
        camera=small_camera,
        camera_height_m=2.3,
        pitch_deg=22.0,
        slope_deg=slope_deg,
        uphill_deg=130.0,
        grass=grass(0.3, share, column_m, seed=3),
    )
    tree = measured(stand, seed=3)
    if isinstance(tree.cut_height_m, Failure):
        assert tree.cut_height_m.reason.startswith("plants hide the ground: the felling cut is ")
    else:
        low_m, high_m = tree.cut_height_m.interval95
        assert low_m < stand.cut_height_m(high) < high_m
    assert any("the stump" in warning for warning in tree.evidence.warnings)
    assert "plants, which may hide the ground" in tree.evidence.ground
    assert tree.distance_m
    assert tree.diameter_m


@pytest.mark.parametrize("slope_deg", [0.0, 15.0])
@pytest.mark.parametrize("ahead_m", [4.5, 5.5, 6.0])
def test_closed_grass_makes_heights_doubtful_from_afar(
    scene, pole, grass, small_camera, ahead_m, slope_deg
):
    """Where no gaps show the ground, and the noise of the depth hides how rough the grass is."""
    stem = pole(0.3, 0.1, ahead_m, cut_m=0.35, section_m=0.5, taper=0.02)
    stand = scene(
        stem,
        camera=small_camera,
        camera_height_m=2.3,
        pitch_deg=22.0,
        slope_deg=slope_deg,
        uphill_deg=130.0,
        grass=grass(0.3, 0.9, 0.03, seed=4),
    )
    height = measured(stand, seed=4).cut_height_m
    if not isinstance(height, Failure):
        assert abs(height.value - stand.cut_height_m(stem)) < 2.0 * height.std


def white_noise_depth_m(stand, noise_per_m):
    """Depth whose noise differs from pixel to pixel, which makes any surface look rough."""
    noise = np.random.default_rng(2).standard_normal(stand.depth_m.shape)
    return (stand.depth_m + noise_per_m * stand.depth_m**2 * noise).astype(np.float32)


@pytest.mark.parametrize("slope_deg", [0.0, 20.0])
@pytest.mark.parametrize("ahead_m", [3.0, 6.0])
@pytest.mark.parametrize("noise_per_m", [0.002, 0.004])
def test_noise_of_the_camera_is_not_taken_for_plants(
    scene, pole, small_camera, noise_per_m, ahead_m, slope_deg
):
    stem = pole(0.3, 0.1, ahead_m, taper=0.02)
    stand = scene(
        stem, camera=small_camera, camera_height_m=2.3, pitch_deg=22.0, slope_deg=slope_deg
    )
    depth_m = white_noise_depth_m(stand, noise_per_m)
    masks = stand.masks()
    tree = stand.measure(stand.detections(masks), depth_m, masks=masks, settings=None)
    height = tree.cut_height_m
    assert height.value == pytest.approx(stand.cut_height_m(stem), abs=0.04)
    assert height.std < 0.1
    assert not any("plants" in warning for warning in tree.evidence.warnings)
