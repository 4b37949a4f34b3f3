"""Direction of the lean, and the cut point in machine coordinates."""

import numpy as np
import pytest

from basetree.errors import InputError
from calib.transform import RigidTransform
from edgetree.measure import Failure, measure_trees


def mounted(stand, position_m=(1.2, -0.4, 1.8), yaw_deg=0.0):
    """Mounting of the scene's camera on a level machine."""
    return RigidTransform.mounting(position_m, -stand.roll_deg, stand.pitch_deg, yaw_deg)


# The scene measures angles from right to away, the measurement from away to right.
@pytest.mark.parametrize(
    ("towards_deg", "expected_deg"), [(90, 0), (0, 90), (270, 180), (180, -90), (45, 45)]
)
@pytest.mark.parametrize("right_m", [0.0, 1.5])
def test_the_direction_is_seen_from_above(scene, pole, towards_deg, expected_deg, right_m):
    stand = scene(pole(0.3, right_m, 4.0, 12.0, towards_deg), pitch_deg=20.0, roll_deg=5.0)
    tree = stand.measure()
    turned_deg = (tree.lean_direction_deg.value - expected_deg + 180) % 360 - 180
    assert turned_deg == pytest.approx(0.0, abs=2.0)
    assert tree.inclination_deg.value == pytest.approx(12.0, abs=0.3)


@pytest.mark.parametrize("diameter_m", [0.15, 0.3, 0.5])
@pytest.mark.parametrize("taper", [0.0, 0.04, 0.07, 0.1])
def test_the_bark_of_a_tapering_stem_recedes_but_its_axis_does_not(
    scene, pole, exact, diameter_m, taper
):
    """The edges of the mask tell the taper."""
    stand = scene(pole(diameter_m, 0.3, 4.0, taper=taper * diameter_m))
    trees = stand.detections(stand.masks())
    tree = stand.measure(trees, masks=stand.masks(), settings=exact)
    assert tree.inclination_deg.value == pytest.approx(0.0, abs=0.2)


def test_upright_stems_have_no_lean_direction(scene, pole):
    upright = scene(pole(0.3, 0.5, 4.0)).measure(settings=None).lean_direction_deg
    assert isinstance(upright, Failure)
    assert upright.reason.startswith("upright within its error: ")
    leaning = scene(pole(0.3, 0.5, 4.0, 15.0, 0.0)).measure(settings=None)
    assert leaning.lean_direction_deg
    assert abs(leaning.lean_direction_deg.value - 90) < 2 * leaning.lean_direction_deg.std + 1


def test_the_direction_is_more_certain_for_larger_leans(scene, pole):
    stds = [
        scene(pole(0.3, 0.5, 4.0, lean, 0.0)).measure(settings=None).lean_direction_deg.std
        for lean in (8.0, 24.0)
    ]
    assert stds[0] > 2 * stds[1]


@pytest.mark.parametrize(("yaw_deg", "pitch_deg", "roll_deg"), [(0, 8, 0), (0, 20, 4), (90, 15, 0)])
def test_the_cut_point_in_machine_coordinates(scene, pole, yaw_deg, pitch_deg, roll_deg):
    stand = scene(pole(0.3, 0.5, 4.0), pitch_deg=pitch_deg, roll_deg=roll_deg)
    tree = stand.measure(mounting=mounted(stand, yaw_deg=yaw_deg))
    # Camera right and forward, then machine axes: x forward, y left, z up.
    right_m, down_m, ahead_m = stand.to_camera.T @ stand.cut_point(stand.poles[0])
    forward_m, left_m = {0: (ahead_m, -right_m), 90: (right_m, ahead_m)}[yaw_deg]
    expected = (1.2 + forward_m, -0.4 + left_m, 1.8 - down_m)
    assert tree.cut_point_machine_m.xyz_m == pytest.approx(expected, abs=0.005)
    assert np.linalg.norm(tree.cut_point_machine_m.std_m) == pytest.approx(
        np.linalg.norm(tree.cut_point_m.std_m)
    )


def test_a_mounting_gives_the_vertical(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0, 10.0, 0.0), pitch_deg=20.0, roll_deg=6.0)
    given = stand.measure(mounting=mounted(stand))
    derived = stand.measure(level=True, mounting=mounted(stand))
    for name in ("diameter_m", "cut_height_m", "inclination_deg", "lean_direction_deg"):
        assert getattr(derived, name) == pytest.approx(getattr(given, name), rel=1e-6)
    assert "along the given vertical" in derived.evidence.ground


def test_a_given_vertical_takes_precedence_over_the_mounting(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0), pitch_deg=20.0)
    wrong = RigidTransform.mounting((0.0, 0.0, 1.8))
    assert stand.measure(mounting=wrong).inclination_deg.value == pytest.approx(0.0, abs=0.3)
    assert stand.measure(level=True, mounting=wrong).inclination_deg.value > 15


def test_without_a_vertical_the_lean_of_a_single_stem_is_uncertain(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0), slope_deg=20.0)
    tree = stand.measure(level=True)
    low_deg, high_deg = tree.inclination_deg.interval95
    assert low_deg < 0 < high_deg
    assert tree.lean_direction_deg.reason == "no vertical given to tell the direction of the lean"
    assert stand.measure().inclination_deg.std < 1.0


def test_a_stems_own_direction_does_not_tell_its_vertical(scene, pole):
    tree = scene(pole(0.3, 0.2, 4.0, 20.0, 0.0), pitch_deg=0.0).measure(level=True)
    assert tree.inclination_deg.value == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize(("lean_deg", "slope_deg", "uphill_deg"), [(30, 25, 0), (35, 30, 90)])
def test_a_lone_leaning_stem_on_a_slope_finds_its_ground(
    scene, pole, lean_deg, slope_deg, uphill_deg
):
    stem = pole(0.3, 0.0, 4.0, lean_deg, uphill_deg)
    stand = scene(
        stem, slope_deg=slope_deg, uphill_deg=uphill_deg, pitch_deg=12.0, camera_height_m=2.4
    )
    tree = stand.measure(level=True, settings=None)
    assert tree.cut_height_m.value == pytest.approx(stand.cut_height_m(stem), abs=0.02)


# Upright poles at several distances, for a vertical from stems.
OTHERS = ((-1.6, 5.0), (-0.6, 6.5), (0.6, 4.5), (1.7, 6.0))


@pytest.mark.parametrize("slope_deg", [0.0, 15.0, 25.0])
@pytest.mark.parametrize("uphill_deg", [0.0, 90.0, 200.0])
def test_other_stems_tell_the_vertical_on_slopes(scene, pole, slope_deg, uphill_deg):
    poles = [pole(0.3, right_m, ahead_m) for right_m, ahead_m in OTHERS]
    leaning = pole(0.25, 0.0, 4.2, 15.0, 0.0)
    stand = scene(
        leaning,
        *poles,
        slope_deg=slope_deg,
        uphill_deg=uphill_deg,
        pitch_deg=12.0,
        roll_deg=5.0,
        camera_height_m=2.2,
    )
    trees = measure_trees(stand.detections(), stand.depth_m, stand.camera)
    for stem, tree in zip(stand.poles, trees, strict=True):
        assert tree.inclination_deg.value == pytest.approx(stem.lean_deg, abs=5.0)
        assert tree.inclination_deg.std < 5.0
        assert abs(tree.cut_height_m.value - stand.cut_height_m(stem)) < 0.03
    assert "4 other stems" in trees[0].evidence.ground
    assert trees[0].lean_direction_deg.value == pytest.approx(90.0, abs=20.0)
    assert not any(tree.lean_direction_deg for tree in trees[1:])


def test_one_fallen_stem_does_not_turn_the_vertical(scene, pole):
    upright = [pole(0.3, right_m, ahead_m) for right_m, ahead_m in OTHERS]
    stand = scene(*upright, pole(0.2, -0.2, 3.0, 40.0, 180.0))
    trees = measure_trees(stand.detections(), stand.depth_m, stand.camera)
    assert max(tree.inclination_deg.value for tree in trees[:4]) < 5.0


def test_stems_alone_tell_the_vertical_where_no_ground_is_seen(scene, pole):
    poles = [pole(0.3, right_m, ahead_m) for right_m, ahead_m in OTHERS]
    stand = scene(*poles, roll_deg=10.0)
    depth_m = np.where(stand.owner > 0, stand.depth_m, 0.0).astype(np.float32)
    trees = measure_trees(stand.detections(), depth_m, stand.camera)
    assert not any(tree.cut_height_m for tree in trees)
    assert all(tree.inclination_deg.value < 5.0 for tree in trees)
    [lone] = measure_trees(stand.detections().select([0]), depth_m, stand.camera)
    assert "no vertical: no ground around the base" in lone.inclination_deg.reason


@pytest.mark.parametrize(
    ("up", "seen"), [((0.04, 0.99, 0.07), "upside down"), ((0.0, 0.1, 1.0), "at the sky")]
)
def test_gravity_in_place_of_up_is_refused(scene, pole, up, seen):
    stand = scene(pole(0.3, 0.5, 4.0))
    with pytest.raises(InputError, match=f"so that the camera looks {seen}: expected the direc"):
        measure_trees(stand.detections(), stand.depth_m, stand.camera, up_camera=up)
    axes_forgotten = RigidTransform.identity()
    with pytest.raises(InputError, match="at the sky"):
        measure_trees(stand.detections(), stand.depth_m, stand.camera, mounting=axes_forgotten)


def test_without_a_mounting_there_are_no_machine_coordinates(scene, pole):
    tree = scene(pole(0.3, 0.5, 4.0)).measure()
    assert tree.cut_point_machine_m == Failure("no mounting of the camera given")
    assert tree.cut_point_m


def test_the_cut_point_is_most_certain_across_the_line_of_sight(scene, pole):
    stand = scene(pole(0.3, 0.0, 6.0), pitch_deg=0.0, camera_height_m=0.4)
    std_m = stand.measure(depth_m=stand.noisy_depth_m(2, 0.01)).cut_point_m.std_m
    assert std_m[2] > 2 * std_m[0]
