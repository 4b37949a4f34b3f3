"""Diameter at breast height, 1.3 m above the uphill side, of tapering stems."""

from dataclasses import replace

import numpy as np
import pytest

from calib import GroundPlane, fit_ground_plane, project_points
from edgetree.measure import Failure, MeasureSettings
from edgetree.measure.base_ground import BaseGround
from edgetree.measure.vertical import Verticals


def at_breast_height_m(stand, height_m=1.3):
    """Diameter of the cone at a height above the ground on the uphill side."""
    [stem] = stand.poles
    lean = np.cos(np.radians(stem.lean_deg))
    # The uphill side is one radius of the section from the axis.
    uphill_m = stem.diameter_at_m(stem.section_m) / 2 * np.linalg.norm(stand.gradient)
    return stem.diameter_at_m((height_m + uphill_m) / lean)


CONES = pytest.mark.parametrize(
    ("diameter_m", "right_m", "ahead_m", "lean_deg", "towards_deg", "slope_deg"),
    [
        (0.4, 0.3, 4.0, 0.0, 0.0, 0.0),
        (0.2, -1.0, 3.0, 0.0, 0.0, 0.0),
        (0.5, 1.0, 6.0, 15.0, 0.0, 0.0),
        (0.4, -0.5, 5.0, 15.0, 270.0, 10.0),
        (0.6, 0.0, 5.0, 5.0, 45.0, 25.0),
    ],
)


@CONES
def test_a_cone_is_measured_where_breast_height_lies(
    scene, pole, diameter_m, right_m, ahead_m, lean_deg, towards_deg, slope_deg
):
    stem = pole(diameter_m, right_m, ahead_m, lean_deg, towards_deg, taper=0.02)
    stand = scene(stem, slope_deg=slope_deg, uphill_deg=30.0)
    tree = stand.measure(masks=stand.masks())
    expected_m = at_breast_height_m(stand)
    section_m = stem.diameter_at_m(stem.section_m)
    assert tree.dbh_m.value == pytest.approx(expected_m, rel=0.013)
    assert tree.dbh_m.value < 0.98 * section_m
    assert tree.diameter_m.value == pytest.approx(section_m, rel=0.005)


@pytest.mark.parametrize("slope", [0.0, 0.2, 0.55])
@pytest.mark.parametrize("lean", [0.0, 0.4])
def test_axis_length_ends_at_the_height_above_the_uphill_side(slope, lean):
    across, ahead = np.random.default_rng(2).uniform(-1, 1, (2, 50))
    plane = fit_ground_plane(np.stack([across, 1.5 - slope * ahead, 4 + ahead], -1))
    assert isinstance(plane, GroundPlane)
    ground = BaseGround(plane, Verticals(np.array([0.0, -1.0, 0.0])).at(0, None), 1.0)
    along = np.array([np.sin(lean), -np.cos(lean), 0.0])
    axis_point = np.array([0.0, 1.5, 4.0]) + 0.3 * along
    up_axis_m = ground.axis_length_m(axis_point, along, 0.2, 1.3)
    # The ground is 0.3 m further down; on the uphill side it is higher by slope * radius.
    assert (0.3 + up_axis_m) * np.cos(lean) - 0.2 * slope == pytest.approx(1.3)


def test_low_plants_lift_the_plane_above_the_ground():
    across, ahead = np.random.default_rng(2).uniform(-1, 1, (2, 90))
    ground_m = np.stack([across, np.full(90, 1.5), 4 + ahead], -1)
    ground_m[:30, 1] -= np.linspace(0.02, 0.3, 30)
    plane = fit_ground_plane(ground_m)
    assert isinstance(plane, GroundPlane)
    ground = BaseGround(plane, Verticals(np.array([0.0, -1.0, 0.0])).at(0, None))
    assert 0.0005 < ground.lift_m < plane.residual_std_m
    along, point = np.array([0.0, -1.0, 0.0]), np.array([0.0, 1.0, 4.0])
    height = ground.height_m(point, along, 0.0)
    assert height.value == pytest.approx(float(plane.height_m(point)) + ground.lift_m, abs=1e-5)
    raised = point + ground.axis_length_m(point, along, 0.0, 1.3) * along
    assert ground.height_m(raised, along, 0.0).value == pytest.approx(1.3)


def test_breast_height_is_a_setting(scene, pole, exact):
    stand = scene(pole(0.4, 0.3, 4.0, taper=0.03))
    settings = replace(exact, breast_height_m=0.9)
    tree = stand.measure(masks=stand.masks(), settings=settings)
    assert tree.dbh_m.value == pytest.approx(at_breast_height_m(stand, 0.9), rel=0.01)


def test_the_standard_deviation_covers_a_coarse_mask(scene, pole):
    stand = scene(pole(0.4, 0.3, 4.0, taper=0.04))
    low_m, high_m = stand.measure(settings=None).dbh_m.interval95
    assert low_m < at_breast_height_m(stand) < high_m
    assert high_m - low_m < 0.16


def test_a_mask_that_ends_below_breast_height(scene, pole):
    stand = scene(pole(0.4, 0.3, 4.0))
    row = project_points(stand.camera, stand.axis_point(stand.poles[0], 0.9))[1]
    mask = stand.owner == 1
    mask[: int(row)] = False
    tree = stand.measure(masks=[mask])
    assert tree.diameter_m.value == pytest.approx(0.4, rel=0.01)
    assert tree.dbh_m == Failure("the stem is not seen at breast height")


def test_a_stem_hidden_at_breast_height(scene, pole):
    stand = scene(pole(0.4, 0.3, 4.0))
    points = [stand.axis_point(stand.poles[0], height_m) for height_m in (1.9, 0.7)]
    top, bottom = project_points(stand.camera, points)[:, 1].astype(int)
    mask = stand.owner == 1
    mask[top:bottom] = False
    assert stand.measure(masks=[mask]).dbh_m == Failure("the stem is not seen at breast height")


def test_without_masks_or_ground_there_is_no_dbh(scene, pole):
    stand = scene(pole(0.4, 0.3, 4.0))
    bare = stand.measure(replace(stand.detections(), masks=None))
    assert bare.dbh_m == Failure("the model gives no masks to see the stem at breast height")
    floating = np.where(stand.owner == 1, stand.depth_m, 0).astype(np.float32)
    assert stand.measure(depth_m=floating).dbh_m.reason.startswith("no ground around the base: ")
    assert MeasureSettings().breast_height_m == 1.3
