"""One shift of the depth explains all feet of a frame; feet that move alone tell none."""

import numpy as np
import pytest

from edgetree.measure.late_depth import late_depth


def told(beyond_m, std_m=0.15, other=0.05, beside=False):
    beyond = np.array(beyond_m, np.float64)
    return late_depth(beyond, np.full(len(beyond), std_m), np.full(len(beyond), other), beside)


@pytest.mark.parametrize("shift_m", [-0.4, 0.4])
def test_feet_that_are_all_as_far_off_tell_late_depth(shift_m):
    late = told([shift_m, shift_m - 0.05, shift_m + 0.05])
    assert late.probability > 0.8
    assert late.beyond_m == pytest.approx(shift_m, abs=0.08)
    assert late.expected_m == pytest.approx(shift_m, abs=0.08)
    assert late.std_m < 0.15
    assert late.size_m == pytest.approx(np.hypot(late.std_m, late.expected_m))


def test_less_probable_late_depth_is_a_doubt_and_no_correction():
    late = told([-0.35], std_m=0.1)
    assert late.expected_m == 0
    assert late.std_m == late.size_m > 0.05


def test_feet_in_place_and_no_feet_tell_nothing():
    assert told([0.05, -0.1, 0.1]).std_m == 0
    assert told([0.05], beside=True).std_m < 0.1
    assert told([]).std_m == told([], beside=True).std_m == 0


def test_one_foot_that_is_moved_alone_is_not_late_depth():
    assert told([-0.6, 0.0, 0.05]).std_m == 0
    assert told([-0.6, 0.0, 0.05], std_m=0.1).std_m == 0


def test_feet_that_plants_hide_tell_less():
    open_ground, plants = told([-0.45, -0.45]), told([-0.45, -0.45], other=0.8)
    assert plants.probability < 0.5 * open_ground.probability


def test_depth_beside_the_picture_is_more_often_late():
    assert told([-0.25]).probability < 0.2 * told([-0.25], beside=True).probability


def test_a_foot_that_tells_nothing_changes_nothing():
    late = late_depth(
        np.array([-0.4, -0.4, 80.0]), np.array([0.1, 0.1, 1e6]), np.full(3, 0.05), False
    )
    assert late.probability == pytest.approx(told([-0.4, -0.4], 0.1).probability, abs=0.02)
