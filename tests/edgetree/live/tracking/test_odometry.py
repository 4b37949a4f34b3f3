"""The camera's motion from depth images."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from cylinder_forest import cylinder_frame, mounted
from simulated_stand import detections

from basetree.errors import MissingPackage
from edgetree.live.tracking import DepthOdometry, StemTracker

PLACES_M = np.array([[5.0, -2.0], [6.5, 0.5], [4.5, 2.0], [8.0, 3.0], [8.5, -3.5], [9.0, -0.5]])
RADII_M = np.array([0.2, 0.15, 0.12, 0.3, 0.25, 0.2])


def frames(mountings, **settings):
    return [
        cylinder_frame(PLACES_M, RADII_M, mounting, 0.1 * number, **settings)
        for number, mounting in enumerate(mountings)
    ]


@pytest.fixture
def odometry() -> DepthOdometry:
    pytest.importorskip("small_gicp")
    return DepthOdometry()


def test_a_step_with_a_turn_and_a_roll_is_found(odometry):
    then, now = mounted(0, 0), mounted(0.15, -0.05, heading_deg=3.0, roll_deg=1.5)
    first, second = frames([then, now], noise_m=0.01)
    assert odometry.step(first, None) is None
    step = odometry.step(second, None)
    true = now.then(then.inverse())
    off = step.transform.then(true.inverse())
    assert np.linalg.norm(off.translation_m) < 0.02
    assert np.degrees(np.arccos((np.trace(off.rotation) - 1) / 2)) < 0.3
    std_m = np.sqrt(np.diag(step.covariance)[3:])
    assert (np.abs(step.transform.translation_m - true.translation_m) < 4 * std_m).all()


def test_errors_do_not_add_up_while_the_camera_stands(odometry):
    standing = frames([mounted(0, 0)] * 60, noise_m=0.02)
    steps = [odometry.step(frame, None) for frame in standing]
    way = np.sum([step.transform.translation_m for step in steps[1:]], axis=0)
    assert np.linalg.norm(way) < 0.02


def test_level_ground_alone_tells_no_motion(odometry):
    none = np.zeros((0, 2))
    for number in range(2):
        frame = cylinder_frame(none, none[:, 0], mounted(0.2 * number, 0), number, noise_m=0.01)
        assert odometry.step(frame, None) is None


def test_frames_without_usable_depth_give_no_step(odometry):
    first, second, third = frames([mounted(0, 0), mounted(0.1, 0), mounted(0.2, 0)])
    odometry.step(first, None)
    for spoilt in (
        replace(second, depth_m=None),
        replace(second, camera=None),
        replace(second, depth_fault="no reading"),
        replace(second, depth_m=np.zeros_like(second.depth_m)),
        replace(second, depth_m=np.full_like(second.depth_m, np.nan)),
    ):
        odometry.step(first, None)
        assert odometry.step(spoilt, None) is None
        assert odometry.step(third, None) is None, "the frame before had no depth"


def test_steps_are_found_across_a_change_of_the_pictures_size(odometry):
    whole = frames([mounted(0.1 * number, 0) for number in range(5)])
    camera = replace(whole[0].camera, width=80, height=45, fx=43.75, fy=43.75, cx=39.75, cy=22.25)
    small = [replace(one, depth_m=one.depth_m[::2, ::2].copy(), camera=camera) for one in whole]
    steps = [odometry.step(frame, None) for frame in (*whole[:2], *small[2:4], whole[4])]
    assert steps[0] is None
    for step in steps[1:]:  # 0.1 m ahead, seen by a camera that looks down by 8 degrees
        true_m = [0.0, -0.1 * np.sin(np.radians(8)), 0.1 * np.cos(np.radians(8))]
        np.testing.assert_allclose(step.transform.translation_m, true_m, atol=0.02)


@pytest.mark.parametrize("vertical", [True, False])
def test_the_map_goes_on_where_no_stem_is_followed(odometry, vertical):
    """No trees at all are given: the place comes from the depth images alone."""
    tracker = StemTracker(odometry=odometry)
    way = [mounted(0.08 * step, 0.01 * step, 0.5 * step) for step in range(30)]
    for frame in frames(way, vertical=vertical, noise_m=0.01):
        if frame.number == 0:
            follow_one_stem(tracker, frame)
        else:
            tracker.update(frame, detections([]), [])
    assert tracker.map_part == 1
    assert tracker.motion.source == "depth"
    x_m, y_m, heading_rad = tracker.motion.state[:3]
    assert (x_m, y_m) == pytest.approx((0.08 * 29, 0.01 * 29), abs=0.08)
    assert np.degrees(heading_rad) == pytest.approx(0.5 * 29, abs=1.0)
    assert tracker.motion.place_std_m < 0.2


def test_without_odometry_the_map_begins_anew():
    tracker = StemTracker()
    way = [mounted(0.08 * step, 0.01 * step) for step in range(60)]
    for frame in frames(way):
        if frame.number == 0:
            follow_one_stem(tracker, frame)
        else:
            tracker.update(frame, detections([]), [])
    assert tracker.map_part == 2


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    with pytest.raises(MissingPackage, match=r"small_gicp: pip install .*odometry"):
        DepthOdometry()


def follow_one_stem(tracker, frame):
    from simulated_stand import Forest

    stand = Forest(np.array([[6.5, 0.5]]), np.array([0.3]), np.random.default_rng(0))
    _, trees, measurements = stand.observe(frame.time_s, (0.0, 0.0), 0.0, pose=False)
    tracker.update(frame, trees, measurements)
