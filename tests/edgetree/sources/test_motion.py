"""Pose and gravity from tf and IMU messages, and registration of depth to colour."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import calib
from calib import RigidTransform
from edgetree.sources.bags.recording import open_recording
from edgetree.sources.gravity import GravityFilter

FRAMES = 10
# A camera that looks along the machine's x, 2 m up and 1 m ahead, tilted down by 10 degrees.
MOUNTING = RigidTransform.mounting((1.0, 0.0, 2.0), pitch_deg=10.0)


def machine_at(second: float) -> RigidTransform:
    """The machine's pose in odom: 1 m/s ahead, turning by 20 degrees a second."""
    return RigidTransform.from_euler_deg(0, 0, 20 * second, (second, 0.5, 0.0))


def write_drive(bags: Any, folder: Path, kind: str, *, has_odom: bool = True) -> Path:
    """Pictures every 0.1 s, odometry every 0.04 s, which is never at the time of a picture."""
    with bags.BagFile(folder, kind) as bag:
        start = bags.START_NS
        bag.tf("base_link", bags.FRAME, MOUNTING, start, "/tf_static")
        frame = bags.small_frame()
        for tick in range(FRAMES * 10):
            now = start + tick * 10_000_000
            if has_odom and tick % 4 == 3:
                pose = machine_at((tick * 10_000_000) / 1e9)
                sign = 1 if tick % 8 == 3 else -1  # both quaternions are the same rotation
                quaternion = sign * bags.quaternion_of(pose.rotation)
                bag.tf("odom", "base_link", pose, now, quaternion=quaternion)
            if tick % 10 == 5:
                bag.image(bags.COLOUR, frame.image, now)
    return bag.path


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_poses_are_interpolated_between_readings_of_tf(
    bags: Any, tmp_path: Path, kind: str
) -> None:
    source = open_recording(write_drive(bags, tmp_path, kind))
    frames = list(source)
    assert len(frames) == FRAMES
    for frame in frames:
        second = frame.time_s - bags.START_NS / 1e9
        assert frame.pose is not None
        expected = MOUNTING.then(machine_at(second))
        np.testing.assert_allclose(frame.pose.translation_m, expected.translation_m, atol=1e-4)
        np.testing.assert_allclose(frame.pose.rotation, expected.rotation, atol=1e-4)
    assert source.counts.get("without pose", 0) == 0


def test_the_transforms_of_old_ros_1_are_read(bags: Any, tmp_path: Path) -> None:
    old = "tf/msg/tfMessage"
    with bags.BagFile(tmp_path, "ros1") as bag:
        bag.store.register({old: bag.store.fielddefs[bags.TF]})
        bag.tf("/odom", f"/{bags.FRAME}", MOUNTING, bags.START_NS, kind=old)
        bag.image(bags.COLOUR, bags.small_frame().image, bags.START_NS, frame=f"/{bags.FRAME}")
    (frame,) = open_recording(bag.path)
    assert frame.pose is not None
    np.testing.assert_allclose(frame.pose.translation_m, MOUNTING.translation_m)


def test_a_hole_in_the_tree_of_transforms(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    source = open_recording(write_drive(bags, tmp_path, "mcap", has_odom=False))
    assert {frame.pose is None for frame in source} == {True}
    assert source.counts["without pose"] == FRAMES
    assert caplog.text.count("no transform from frame 'cam_optical' to odom, map or world") == 1


def test_a_gap_in_time_has_no_pose_and_circles_do_no_harm(bags: Any, tmp_path: Path) -> None:
    with bags.BagFile(tmp_path) as bag:
        still = RigidTransform.identity()
        bag.tf("a", "b", still, bags.START_NS)
        bag.tf("b", "a", still, bags.START_NS)
        for second in (0, 1, 10, 11):
            stamp = bags.START_NS + second * 10**9
            bag.tf("odom", bags.FRAME, still, stamp)
            bag.tf("odom", "zero", still, stamp, quaternion=(0, 0, 0, 0))
        for second in (0.5, 5, 10.5):
            bag.image(bags.COLOUR, bags.small_frame().image, bags.START_NS + round(second * 1e9))
    source = open_recording(bag.path)
    assert [frame.pose is None for frame in source] == [False, True, False]
    assert source.counts["without pose"] == 1
    assert source.counts["transforms that are no rotation"] == 4


def test_motion_goes_on_after_the_clock_jumped_back(bags: Any, tmp_path: Path) -> None:
    with bags.BagFile(tmp_path) as bag:
        for tick in range(80):
            log_ns = bags.START_NS + tick * 50_000_000
            stamp = log_ns - (100 * 10**9 if tick >= 40 else 0)
            place = RigidTransform(np.eye(3), (tick, 0, 0))
            bag.tf("odom", bags.FRAME, place, stamp, log_ns=log_ns)
            bag.imu("/imu", (0, -9.8, 0), stamp, bags.FRAME, log_ns=log_ns)
            if tick % 2:
                bag.image(bags.COLOUR, bags.small_frame().image, stamp, log_ns=log_ns)
    source = open_recording(bag.path)
    frames = list(source)
    assert source.counts["clock jumped back"] == 1
    known = [frame for frame in frames if frame.pose is not None]
    assert len(known) >= 38
    for frame in known[-10:]:
        assert frame.pose is not None
        assert frame.pose.translation_m[0] == pytest.approx(2 * frame.number + 1, abs=0.01)
        np.testing.assert_allclose(frame.up_camera, [0, -1, 0], atol=1e-9)


@pytest.mark.parametrize("of_pictures", [0, 1])
def test_motion_without_stamps_has_the_times_of_recording(
    bags: Any, tmp_path: Path, of_pictures: int
) -> None:
    with bags.BagFile(tmp_path) as bag:
        for tick in range(80):
            log_ns = bags.START_NS + tick * 50_000_000
            place = RigidTransform(np.eye(3), (tick, 0, 0))
            bag.tf("odom", bags.FRAME, place, 0, log_ns=log_ns)
            bag.imu("/imu", (0, -9.8, 0), 0, bags.FRAME, log_ns=log_ns)
            if tick % 2:
                picture = bags.small_frame().image
                bag.image(bags.COLOUR, picture, of_pictures * log_ns, log_ns=log_ns)
    frames = list(open_recording(bag.path))
    for frame in frames[-10:]:
        assert frame.pose is not None
        assert frame.pose.translation_m[0] == pytest.approx(2 * frame.number + 1, abs=0.01)
        np.testing.assert_allclose(frame.up_camera, [0, -1, 0], atol=1e-9)


def test_a_camera_that_is_described_late_is_known_from_the_first_frame_on(
    bags: Any, tmp_path: Path
) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        for number in range(3):
            bag.image(bags.COLOUR, frame.image, bags.START_NS + number * bags.PERIOD_NS)
        bag.info(bags.INFO, frame.camera, bags.START_NS + 10 * bags.PERIOD_NS)
    assert [live.camera for live in open_recording(bag.path)] == [frame.camera] * 3


def test_gravity_is_turned_into_the_cameras_frame(bags: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    with bags.BagFile(tmp_path) as bag:
        # The IMU has the machine's axes: x forward, y left, z up.
        bag.tf("base_link", "imu", RigidTransform.identity(), bags.START_NS, "/tf_static")
        bag.tf("base_link", bags.FRAME, MOUNTING, bags.START_NS, "/tf_static")
        for tick in range(200):
            stamp = bags.START_NS + tick * 10_000_000
            bag.imu("/imu/data", np.array([0, 0, 9.81]) + rng.normal(0, 1, 3), stamp)
            if tick % 10 == 5:
                bag.image(bags.COLOUR, bags.small_frame().image, stamp)
    frames = list(open_recording(bag.path))
    expected = MOUNTING.inverse().rotate([0, 0, 1])
    up = frames[-1].up_camera
    assert up is not None
    assert np.linalg.norm(up) == pytest.approx(1)
    assert np.degrees(np.arccos(up @ expected)) < 1.5
    assert up[1] < -0.9  # a level camera has its y downwards


def test_gravity_without_a_transform_is_counted(bags: Any, tmp_path: Path) -> None:
    with bags.BagFile(tmp_path) as bag:
        for tick in range(20):
            stamp = bags.START_NS + tick * 10_000_000
            bag.imu("/imu/data", (0, 0, 9.81), stamp)
            if tick % 10 == 5:
                bag.image(bags.COLOUR, bags.small_frame().image, stamp)
    source = open_recording(bag.path)
    assert {frame.up_camera is None for frame in source} == {True}
    assert source.counts["without gravity"] == 2


def test_the_filter_follows_a_swinging_crane() -> None:
    """Sway of 5 degrees at 0.5 Hz, with the push of a camera that hangs 3 m below its joint."""
    filtered = GravityFilter()
    worst = 0.0
    rate = 2 * np.pi * 0.5
    for tick in range(2000):
        time_s = tick / 200
        angle = np.radians(5) * np.sin(rate * time_s)
        turn = -np.radians(5) * rate * np.cos(rate * time_s)  # what is fixed turns the other way
        push = -3 * np.radians(5) * rate**2 * np.sin(rate * time_s)
        up = np.array([np.sin(angle), -np.cos(angle), 0])
        filtered.add(time_s, 9.81 * up + [push, 0, 0], np.array([0, 0, turn]))
        if time_s > 4:
            found = filtered.up(time_s)
            assert found is not None
            worst = max(worst, float(np.degrees(np.arccos(np.clip(found @ up, -1, 1)))))
    # The acceleration alone points up to 20 degrees off.
    assert worst < 2.5


def test_depth_of_another_frame_is_registered_to_the_colour(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    beside = RigidTransform(np.eye(3), (0.1, 0, 0))  # the depth camera, 10 cm right of the colour
    with bags.BagFile(tmp_path) as bag:
        bag.tf(bags.FRAME, "depth_optical", beside, bags.START_NS, "/tf_static")
        bag.info(bags.INFO, frame.camera, bags.START_NS)
        bag.info("/cam/depth/camera_info", frame.camera, bags.START_NS, "depth_optical")
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
        bag.image(bags.DEPTH, frame.depth, bags.START_NS, "16UC1", "depth_optical")
    (live,) = open_recording(bag.path)
    depth_m = (frame.depth / 1000).astype(np.float32)
    expected = calib.register_depth(depth_m, frame.camera, frame.camera, beside)
    np.testing.assert_array_equal(live.depth_m, expected)
    assert live.depth_fault is None


def test_depth_that_cannot_be_registered_is_a_fault(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.info(bags.INFO, frame.camera, bags.START_NS)
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
        bag.image(bags.DEPTH, frame.depth, bags.START_NS, "16UC1", "depth_optical")
    source = open_recording(bag.path)
    (live,) = source
    assert live.image is not None
    assert live.depth_fault is not None
    assert "tf has no transform between them: expected aligned depth" in live.depth_fault
    assert source.counts["depth not aligned"] == 1


@pytest.mark.parametrize("value", [1e6, 1e200, 1e308, np.inf, -np.inf, np.nan, 1e-200])
@pytest.mark.parametrize("where", ["acceleration", "turn"])
@pytest.mark.filterwarnings("error")
def test_an_imu_out_of_range_gives_frames_without_gravity(
    bags: Any, tmp_path: Path, value: float, where: str
) -> None:
    frame = bags.small_frame()
    push = (value, value, value) if where == "acceleration" else (0.0, -9.8, 0.0)
    turn = (0.0, value, 0.0) if where == "turn" else (0.0, 0.0, 0.0)
    with bags.BagFile(tmp_path) as bag:
        for number in range(3):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            bag.imu("/imu", push, stamp, bags.FRAME, turn)
            bag.image(bags.COLOUR, frame.image, stamp)
    source = open_recording(bag.path)
    frames = list(source)
    assert len(frames) == 3
    if where == "turn" and value == 1e-200:
        assert frames[0].up_camera is not None
        return
    assert [live.up_camera for live in frames] == [None] * 3
    assert source.counts["without gravity"] == 3
    assert source.counts["IMU samples out of range"] == 3


def test_single_samples_out_of_range_do_not_turn_gravity() -> None:
    gravity = GravityFilter()
    for number in range(100):
        push = (1e200, 0.0, 0.0) if number % 10 == 5 else (0.0, -9.8, 0.0)
        gravity.add(number / 100, np.array(push))
    np.testing.assert_allclose(gravity.up(0.99), [0, -1, 0], atol=1e-9)
    assert gravity.unusable == 10


@pytest.mark.parametrize("unit", [1.0, 1 / 9.81, 1000 / 9.81])
def test_accelerations_in_other_units_are_used(unit: float) -> None:
    gravity = GravityFilter()
    gravity.add(0.0, np.array([0.0, -9.81 * unit, 0.0]))
    np.testing.assert_allclose(gravity.up(0.0), [0, -1, 0])


@pytest.mark.parametrize("value", [1e9, 1e200, 1e308, np.inf, np.nan])
@pytest.mark.parametrize("where", ["place", "turn"])
@pytest.mark.filterwarnings("error")
def test_transforms_out_of_range_are_counted(
    bags: Any, tmp_path: Path, value: float, where: str
) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        place = (value, 0.0, 0.0) if where == "place" else (0.0, 0.0, 0.0)
        transform = SimpleNamespace(translation_m=place)
        quaternion = (0, 0, 0, value) if where == "turn" else (0, 0, 0, 1)
        bag.tf("odom", bags.FRAME, transform, bags.START_NS, quaternion=quaternion)
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
    source = open_recording(bag.path)
    (live,) = source
    assert live.pose is None
    assert source.counts["transforms that are no rotation"] == 1
    assert source.counts["without pose"] == 1


@pytest.mark.parametrize("seconds", [-(2**31), 2**31 - 1])
@pytest.mark.filterwarnings("error")
def test_stamps_out_of_range_of_one_sensor_leave_the_others_as_they_are(
    bags: Any, tmp_path: Path, seconds: int
) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        for number in range(4):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            odd = seconds * 10**9 if number == 2 else stamp
            bag.imu("/imu", (0, -9.8, 0), odd, bags.FRAME, log_ns=stamp)
            identity = RigidTransform.identity()
            bag.tf("odom", bags.FRAME, identity, odd, log_ns=stamp)
            bag.image(bags.COLOUR, frame.image, stamp)
    frames = list(open_recording(bag.path))
    assert len(frames) == 4
    assert all(live.up_camera is not None for live in (frames[0], frames[3]))
