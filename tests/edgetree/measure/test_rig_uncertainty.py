"""The errors of a rig are in every interval that they move."""

from dataclasses import replace

import numpy as np
import pytest

from basetree.errors import InputError
from calib import RigidTransform
from edgetree.measure import EXACT_RIG, RigUncertainty

MOUNTING = RigidTransform.mounting([1.5, 0.0, 2.2], 0.0, 0.0, 0.0)
ROWS = {
    "scale": RigUncertainty(0.01, 0.0, 0.0, 0.0),
    "principal": RigUncertainty(0.0, 10.0, 0.0, 0.0),
    "vertical": RigUncertainty(0.0, 0.0, 2.0, 0.0),
    "mounting": RigUncertainty(0.0, 0.0, 0.0, 2.0),
}


@pytest.fixture(scope="module")
def stand(scene, pole):
    return scene(pole(0.3, 1.5, 6.0))


def measured(stand, rig, **changes):
    seen = {"masks": stand.masks(), "mounting": MOUNTING}
    return stand.measure(rig_uncertainty=rig, **seen, **changes)


@pytest.fixture(scope="module")
def sure(stand):
    return measured(stand, EXACT_RIG)


def added(wide, narrow):
    return np.sqrt(np.asarray(wide) ** 2 - np.asarray(narrow) ** 2)


def test_the_scale_of_the_depth_is_an_error_of_all_lengths(stand, sure):
    tree = measured(stand, ROWS["scale"])
    for name in ("diameter_m", "dbh_m", "distance_m", "axis_distance_m"):
        value = getattr(tree, name)
        share = added(value.std, getattr(sure, name).std) / value.value
        assert share == pytest.approx(0.01, rel=0.05), name
    height = tree.cut_height_m
    assert added(height.std, sure.cut_height_m.std) == pytest.approx(0.01 * height.value, rel=0.2)
    profile, own = tree.profile.diameter_std_m, sure.profile.diameter_std_m
    assert added(profile, own) / tree.profile.diameter_m == pytest.approx(0.01, rel=0.05)
    assert tree.taper_cm_per_m.std == pytest.approx(sure.taper_cm_per_m.std, rel=0.01)


def test_an_offset_of_the_depth_is_in_distances_and_diameters(stand, sure):
    rig = replace(EXACT_RIG, depth_offset_std_m=0.06)
    tree = measured(stand, rig)
    for name in ("distance_m", "axis_distance_m"):
        std = added(getattr(tree, name).std, getattr(sure, name).std)
        assert std == pytest.approx(0.06, rel=0.1), name
    off_m = np.where(stand.depth_m > 0, stand.depth_m + np.float32(0.06), 0).astype(np.float32)
    wrong = measured(stand, rig, depth_m=off_m)
    for name in ("diameter_m", "dbh_m", "distance_m", "axis_distance_m"):
        value, true = getattr(wrong, name), getattr(sure, name)
        assert abs(value.value - true.value) < 1.3 * value.std, name
        assert value.std > true.std, name
    assert abs(wrong.distance_m.value - sure.distance_m.value) > 3 * sure.distance_m.std


def test_an_offset_does_not_average_away(stand, sure):
    tree = measured(stand, replace(EXACT_RIG, depth_offset_std_m=0.06))
    for name in ("diameter_m", "dbh_m"):
        own = added(getattr(tree, name).std, getattr(sure, name).std)
        assert tree.rig_std[name] == pytest.approx(own, rel=0.1), name


def test_what_is_said_of_a_scale_covers_a_scale_that_is_wrong(stand, sure):
    wrong = measured(stand, ROWS["scale"], depth_m=stand.depth_m * np.float32(1.01))
    for name in ("diameter_m", "distance_m", "axis_distance_m", "cut_height_m"):
        value = getattr(wrong, name)
        off = abs(value.value - getattr(sure, name).value)
        assert off < 1.3 * value.std, name
    assert abs(wrong.distance_m.value - sure.distance_m.value) > 3 * sure.distance_m.std
    off_m = wrong.cut_point_m.xyz_m - sure.cut_point_m.xyz_m
    assert (np.abs(off_m) < 1.3 * wrong.cut_point_m.std_m + 0.005).all()


def test_a_principal_point_that_is_wrong_turns_all_rays(stand, sure):
    camera = stand.camera
    shifted = replace(stand, camera=replace(camera, cx=camera.cx + 10, cy=camera.cy - 10))
    rig = ROWS["principal"]
    seen = {"masks": stand.masks(), "mounting": MOUNTING, "rig_uncertainty": rig}
    wrong = shifted.measure(stand.detections(), stand.depth_m, **seen)
    off_m = np.abs(wrong.cut_point_m.xyz_m - sure.cut_point_m.xyz_m)[:2]
    assert off_m == pytest.approx(6.0 * 10 / camera.fx, rel=0.1)
    assert (off_m < 1.3 * wrong.cut_point_m.std_m[:2]).all()
    assert (off_m > 3 * sure.cut_point_m.std_m[:2]).all()
    point = wrong.axis.point_covariance_m2 - sure.axis.point_covariance_m2
    assert np.sqrt(point[0, 0]) == pytest.approx(6.0 * 10 / camera.fx, rel=0.2)


def test_an_uncertain_vertical_is_an_error_of_the_lean(stand, sure):
    tree = measured(stand, ROWS["vertical"])
    share = added(tree.inclination_deg.std, sure.inclination_deg.std)
    assert share == pytest.approx(2.0, rel=0.05)
    assert tree.cut_height_m.std > sure.cut_height_m.std
    assert tree.distance_m.std == pytest.approx(sure.distance_m.std, rel=0.05)


def test_an_uncertain_mounting_turns_points_about_the_camera(stand, sure):
    tree = measured(stand, ROWS["mounting"])
    assert tree.cut_point_m.std_m == pytest.approx(sure.cut_point_m.std_m)
    share = added(tree.cut_point_machine_m.std_m, sure.cut_point_machine_m.std_m)
    # To the side and up the whole distance turns, ahead only what lies to the side and below.
    assert share[1:] == pytest.approx(np.radians(2.0) * 6.0, rel=0.1)
    assert share[0] < 0.5 * share[1]


def test_a_focal_length_turns_rays_away_from_the_middle(scene, pole):
    known = scene(pole(0.3, 2.5, 6.0))
    unsure = replace(known, camera=replace(known.camera, focal_std_px=14.0))
    wide, narrow = (measured(each, EXACT_RIG).cut_point_m.std_m[0] for each in (unsure, known))
    assert added(wide, narrow) == pytest.approx(2.5 * 14 / 700, rel=0.1)


def test_what_is_not_stated_is_assumed(stand):
    unstated, stated = measured(stand, None), measured(stand, RigUncertainty(0.0, 0.0, 0.1, 0.1))
    assert unstated.distance_m.std > 1.5 * stated.distance_m.std
    assumed = RigUncertainty(depth_scale_std=0.0).assumed(stand.camera, True, False)
    assert assumed == ["principal point 7.7 px", "vertical 2 degrees"]
    camera = replace(stand.camera, principal_std_px=0.5)
    assert RigUncertainty().assumed(camera, False, False) == ["depth scale 0.7 %"]
    assert RigUncertainty().errors(camera).ray == pytest.approx(0.5 / 700)


@pytest.mark.parametrize(
    ("name", "value"),
    [("depth_scale_std", -0.1), ("principal_std_px", np.inf), ("vertical_std_deg", 91.0)],
)
def test_errors_of_a_rig_are_checked(name, value):
    with pytest.raises(InputError, match=f"the rig error {name} is {value:g}: expected 0"):
        RigUncertainty(**{name: value})
