"""Every term of a stated error widens the interval where it should."""

from dataclasses import replace

import numpy as np
import pytest

from calib import GroundPlane, fit_ground_plane
from edgetree.measure import MeasureSettings
from edgetree.measure.base_ground import BaseGround
from edgetree.measure.section import axes_in_planes
from edgetree.measure.vertical import Verticals
from edgetree.measure.width import MaskWidths

UP = np.array([0.0, -1.0, 0.0])


@pytest.fixture(scope="module")
def stand(scene, pole):
    return scene(pole(0.3, 0.5, 4.0))


def added(with_term, without):
    """The standard deviation that one term adds to the others."""
    return float(np.sqrt(with_term.std**2 - without.std**2))


def test_stems_are_less_round_at_breast_height_than_at_the_section(stand, exact):
    uneven = replace(exact, out_of_round_std=0.1)
    tree, smooth = (stand.measure(masks=stand.masks(), settings=each) for each in (uneven, exact))
    assert added(tree.diameter_m, smooth.diameter_m) == pytest.approx(0.1 * 0.3, rel=0.02)
    assert added(tree.dbh_m, smooth.dbh_m) > 1.2 * 0.1 * 0.3


def test_the_shape_between_section_and_cut_moves_the_axis(stand, exact):
    uneven = replace(exact, out_of_round_std=0.1)
    tree, smooth = (stand.measure(settings=each) for each in (uneven, exact))
    # Half of the diameter's error alone would be 0.5 times it.
    assert added(tree.distance_m, smooth.distance_m) > 1.5 * 0.1 * 0.3


def test_heights_are_no_more_certain_than_litter_and_moss(stand):
    assert 0.015 < stand.measure().cut_height_m.std < 0.045


def test_points_off_the_plane_make_heights_doubtful():
    across, ahead = np.random.default_rng(2).uniform(-1, 1, (2, 90))
    flat = fit_ground_plane(np.stack([across, np.full(90, 1.5), 4 + ahead], -1))
    assert isinstance(flat, GroundPlane)
    vertical = Verticals(UP).at(0, None)
    stds_m = [
        BaseGround(replace(flat, inlier_fraction=share), vertical)
        .height_m(np.array([0.0, 1.2, 4.0]), UP, 0.1)
        .std
        for share in (1.0, 0.7, 0.4)
    ]
    assert stds_m[1] > 1.02 * stds_m[0]
    assert stds_m[2] > 2 * stds_m[0]


def test_the_edges_of_the_mask_count_in_diameters_along_the_stem(stand, exact):
    rough = replace(exact, given_mask_std_px=6.0)
    tree, sharp = (stand.measure(masks=stand.masks(), settings=each) for each in (rough, exact))
    edges_m = added(tree.dbh_m, sharp.dbh_m)
    one_edge_m = 6.0 * 4.0 / stand.camera.fx
    assert 0.4 * one_edge_m < edges_m < 1.5 * one_edge_m


def test_diameters_near_the_root_collar_are_less_certain(scene, pole):
    stand = scene(pole(0.3, 0.0, 4.0))
    profile = stand.measure(masks=stand.masks()).profile
    relative = profile.diameter_std_m / profile.diameter_m
    assert profile.height_m[0] < 0.25
    assert relative[0] > 2 * np.median(relative)
    assert np.all(np.diff(relative[:8]) < 0)


@pytest.mark.parametrize(("taper", "doubted"), [(0.02, False), (-0.1, True)])
def test_diameters_that_no_tapering_stem_has_are_in_doubt(scene, pole, taper, doubted):
    """As those of the arms of a fork, or of a branch in the mask."""
    stand = scene(pole(0.3, 0.0, 4.0, taper=taper, top_m=3.5))
    std_m = stand.measure(masks=stand.masks()).profile.diameter_std_m
    assert (std_m[-1] > 3 * std_m.min()) == doubted


def with_other_depth(stand, share, depth_m):
    """The scene's depth with that of other things on a share of the stem's pixels."""
    other = np.random.default_rng(0).random(stand.owner.shape) < share
    return np.where(other & (stand.owner == 1), depth_m, stand.depth_m).astype(np.float32)


def test_readings_that_disagree_count_more_than_those_that_are_missing(stand):
    missing, behind = (
        stand.measure(depth_m=with_other_depth(stand, 0.4, depth_m)).axis_distance_m
        for depth_m in (0.0, 9.0)
    )
    assert behind.std > 2 * missing.std


def test_missing_readings_widen_the_distance(stand):
    whole = stand.measure().axis_distance_m
    missing = stand.measure(depth_m=with_other_depth(stand, 0.6, 0.0)).axis_distance_m
    assert added(missing, whole) > 0.01 * missing.value


def test_doubt_counts_for_given_masks_too_but_less(stand, exact):
    careful = replace(exact, readings_doubt=1.9)
    depth_m = with_other_depth(stand, 0.6, 0.0)
    given, careless = (
        stand.measure(depth_m=depth_m, masks=stand.masks(), settings=each).diameter_m
        for each in (careful, exact)
    )
    own = stand.measure(depth_m=depth_m, settings=careful).diameter_m
    assert added(given, careless) > 0.1 * 0.3
    assert own.std > 1.5 * given.std


@pytest.fixture(scope="module")
def seen_from_above(scene, pole):
    """A stem that gets 7 % thinner per metre, 2.6 m below the camera."""
    stem = pole(0.8, 0.0, 5.0, taper=0.056, top_m=4.0)
    return scene(stem, camera_height_m=3.0, pitch_deg=20.0)


def test_the_axis_of_a_tapering_stem_does_not_lean_away(seen_from_above):
    distance = seen_from_above.measure(masks=seen_from_above.masks()).axis_distance_m
    assert distance.value == pytest.approx(5.0, abs=0.025)


def test_the_taper_is_not_known(seen_from_above):
    distance = seen_from_above.measure(masks=seen_from_above.masks()).axis_distance_m
    assert distance.std > 0.02


def test_a_width_is_less_certain_far_from_the_edges_it_is_read_from():
    height_m = np.linspace(0.0, 1.0, 24)[None]
    bearing = np.stack([np.full((1, 24), -0.05), np.full((1, 24), 0.05)])
    valid = np.ones((2, 1, 24), np.bool_)
    widths = MaskWidths(height_m, bearing, valid, np.array([1e-4]))
    near, far = (widths.at(np.array([at]))[0].std_rad[0] for at in (0.5, 3.0))
    assert near < 0.02 * 0.05
    assert far > 0.08 * 0.05


def test_many_stems_may_share_a_lean():
    normals = np.stack([np.ones(100), np.zeros(100), np.zeros(100)], -1)
    axes = axes_in_planes(normals, UP)
    verticals = Verticals.from_stems(axes, np.full(100, 0.01), np.full(100, 0.01), np.radians(6))
    assert 1.5 < np.degrees(verticals.at(0, None).tilt_std_rad) < 3.0


def usual_and_without(stand, **tiny):
    """Measurements with the usual settings, and without one of their terms."""
    usual = MeasureSettings()
    masks = stand.masks()
    return (stand.measure(masks=masks, settings=each) for each in (usual, replace(usual, **tiny)))


def test_real_stems_bend(stand):
    tree, straight = usual_and_without(stand, bend_std_deg=1e-9)
    assert added(tree.inclination_deg, straight.inclination_deg) > 0.4
    assert added(tree.axis_distance_m, straight.axis_distance_m) > 0.001


def test_real_stems_are_not_round(stand):
    tree, round_one = usual_and_without(stand, out_of_round_std=1e-9)
    assert added(tree.diameter_m, round_one.diameter_m) > 0.005 * 0.3


def test_all_readings_share_an_error_that_grows_with_the_square_of_the_distance(scene, pole):
    added_m = []
    for ahead_m in (4.0, 8.0):
        tree, unbiased = usual_and_without(scene(pole(0.3, 0.0, ahead_m)), depth_bias_per_m=1e-9)
        added_m.append(added(tree.axis_distance_m, unbiased.axis_distance_m))
    assert added_m[1] > 0.01
    assert added_m[1] / added_m[0] == pytest.approx(4.0, rel=0.1)
