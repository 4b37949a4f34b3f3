"""Direction of the lean, and the cut point in machine coordinates."""

import numpy as np
import pytest

from calib.transform import RigidTransform
from edgetree.errors import InputError
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


def test_without_a_vertical_a_lean_is_as_uncertain_as_the_ground(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0), slope_deg=12.0)
    tree = stand.measure(level=True)
    assert tree.inclination_deg.value == pytest.approx(12.0, abs=0.5)
    low_deg, high_deg = tree.inclination_deg.interval95
    assert low_deg < 0 < high_deg
    assert stand.measure().inclination_deg.std < 1.0


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
