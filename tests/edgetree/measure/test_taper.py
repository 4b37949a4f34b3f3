"""Diameters along tapering stems: profile, taper, volume of the seen part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import project_points
from edgetree.measure import Failure, StemProfile

CONES = pytest.mark.parametrize(
    ("diameter_m", "right_m", "ahead_m", "lean_deg", "slope_deg"),
    [(0.4, 0.3, 4.0, 0.0, 0.0), (0.2, -1.0, 3.0, 0.0, 0.0), (0.5, 1.0, 6.0, 12.0, 15.0)],
)


def cone(scene, pole, diameter_m, right_m, ahead_m, lean_deg, slope_deg):
    """A stem that gets 2 cm thinner per metre, and its measurement by exact outlines."""
    stem = pole(diameter_m, right_m, ahead_m, lean_deg, taper=0.02)
    stand = scene(stem, slope_deg=slope_deg, uphill_deg=30.0)
    return stand, stem, stand.measure(masks=stand.masks())


def along_m(stand, stem, height_m):
    """Positions along the axis of heights above the ground on the uphill side."""
    uphill_m = stem.diameter_at_m(stem.section_m) / 2 * np.linalg.norm(stand.gradient)
    return (height_m + uphill_m) / np.cos(np.radians(stem.lean_deg))


@CONES
def test_the_profile_follows_a_cone(scene, pole, diameter_m, right_m, ahead_m, lean_deg, slope_deg):
    stand, stem, tree = cone(scene, pole, diameter_m, right_m, ahead_m, lean_deg, slope_deg)
    profile = tree.profile
    assert isinstance(profile, StemProfile)
    assert profile.heights_from == "ground"
    assert profile.height_m[-1] > 2.3
    np.testing.assert_allclose(np.diff(profile.height_m), 0.1)
    expected_m = stem.diameter_at_m(along_m(stand, stem, profile.height_m))
    np.testing.assert_allclose(profile.diameter_m, expected_m, rtol=0.015)
    at_breast = np.argmin(np.abs(profile.height_m - 1.3))
    assert profile.diameter_m[at_breast] == pytest.approx(tree.dbh_m.value)
    assert profile.diameter_std_m[at_breast] == pytest.approx(tree.dbh_m.std)


@CONES
def test_taper_and_volume_of_a_cone(scene, pole, diameter_m, right_m, ahead_m, lean_deg, slope_deg):
    stand, stem, tree = cone(scene, pole, diameter_m, right_m, ahead_m, lean_deg, slope_deg)
    low, high = (along_m(stand, stem, tree.profile.height_m[end]) for end in (0, -1))
    thick, thin = stem.diameter_at_m(low), stem.diameter_at_m(high)
    expected_m3 = np.pi / 12 * (high - low) * (thick**2 + thick * thin + thin**2)
    assert tree.seen_volume_m3.value == pytest.approx(expected_m3, rel=0.02)
    # All diameters of a stem share their errors, so these do not average out.
    relative = np.median(tree.profile.diameter_std_m / tree.profile.diameter_m)
    assert 1.5 * relative < tree.seen_volume_m3.std / expected_m3 < 3.5 * relative
    assert tree.taper_cm_per_m.value == pytest.approx(2.0, abs=0.4)
    assert abs(tree.taper_cm_per_m.value - 2.0) < 2 * tree.taper_cm_per_m.std


def test_the_ends_of_the_diameters_are_at_the_edges_of_the_mask(scene, pole):
    stand = scene(pole(0.4, 0.3, 4.0, taper=0.02))
    profile = stand.measure(masks=stand.masks()).profile
    ends_px = project_points(stand.camera, profile.edges_m)
    for left, right in ends_px:
        columns = np.flatnonzero(stand.owner[int((left[1] + right[1]) / 2)] == 1)
        assert left[0] == pytest.approx(columns[0], abs=2.0)
        assert right[0] == pytest.approx(columns[-1] + 1, abs=2.0)


def test_hidden_parts_have_no_diameters(scene, pole):
    stem = pole(0.4, 0.3, 4.0)
    stand = scene(stem)
    rows = project_points(stand.camera, [stand.axis_point(stem, height) for height in (1.9, 0.7)])
    mask = stand.owner == 1
    mask[int(rows[0, 1]) : int(rows[1, 1])] = False
    height_m = stand.measure(masks=[mask]).profile.height_m
    assert not ((height_m > 1.0) & (height_m < 1.6)).any()
    assert height_m[0] < 0.7
    assert height_m[-1] > 2.0


def test_the_root_collar_has_no_diameters(scene, pole):
    stand = scene(pole(0.6, 0.0, 5.0))
    assert stand.measure(masks=stand.masks()).profile.height_m[0] >= 0.3


def test_without_a_ground_heights_are_from_the_section(scene, pole):
    stem = pole(0.4, 0.3, 4.0, taper=0.02)
    stand = scene(stem)
    floating = np.where(stand.owner == 1, stand.depth_m, 0).astype(np.float32)
    profile = stand.measure(masks=stand.masks(), depth_m=floating).profile
    assert profile.heights_from == "section"
    expected_m = stem.diameter_at_m(stem.section_m + profile.height_m)
    np.testing.assert_allclose(profile.diameter_m, expected_m, rtol=0.015)


def test_without_masks_there_are_no_diameters(scene, pole):
    stand = scene(pole(0.4, 0.3, 4.0))
    tree = stand.measure(replace(stand.detections(), masks=None))
    reason = Failure("the model gives no masks to see the edges of the stem")
    assert (tree.profile, tree.taper_cm_per_m, tree.seen_volume_m3) == (reason, reason, reason)


def test_a_short_part_has_a_volume_but_no_taper(scene, pole):
    stem = pole(0.3, 0.0, 4.0)
    stand = scene(stem)
    row = project_points(stand.camera, stand.axis_point(stem, 0.7))[1]
    mask = stand.owner == 1
    mask[: int(row)] = False
    tree = stand.measure(masks=[mask])
    assert 0 < tree.seen_volume_m3.value < 0.05
    assert tree.taper_cm_per_m.reason.startswith("the taper needs 0.5 m of the stem: ")


@pytest.mark.parametrize("lean_deg", [0.0, 10.0])
def test_the_axis_distance_is_perpendicular_to_the_axis(scene, pole, lean_deg):
    stem = pole(0.3, 0.8, 4.0, lean_deg, 90.0, taper=0.02)
    stand = scene(stem)
    foot, along = stand.foot(stem), stand.along(stem)
    expected_m = np.linalg.norm(foot - (foot @ along) * along)
    axis = stand.measure(masks=stand.masks()).axis_distance_m
    assert axis.value == pytest.approx(expected_m, abs=0.02)
    assert axis.std < 0.05


def test_the_axis_distance_needs_no_cut(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0))
    trees = stand.detections()
    trees.keypoints_px[0, 0, 2] = 0.0
    tree = stand.measure(trees)
    assert tree.distance_m == Failure("the felling cut is not in the image")
    assert tree.axis_distance_m.value == pytest.approx(stand.measure().axis_distance_m.value)


@pytest.mark.parametrize(("taper", "is_doubted"), [(0.01, False), (-0.03, False), (-0.06, True)])
def test_what_gets_thicker_upwards_is_in_doubt(scene, pole, taper, is_doubted):
    """As where the arms of a fork have one outline."""
    stand = scene(pole(0.3, ahead_m=5.0, top_m=4.0, taper=taper, section_m=1.0, cut_m=0.8))
    trees = replace(stand.detections(), keypoints_px=None)
    tree = stand.measure(trees, level=True, masks=stand.masks())
    grown_m = tree.dbh_m.value - 0.3
    assert (tree.dbh_m.std > 0.6 * grown_m > 0.03) == is_doubted
