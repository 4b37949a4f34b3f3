"""Drives: poses, tree numbers, IMU samples and labels are consistent."""

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from calib import PinholeCamera, opencv_to_image, pixels_to_rays
from perceptree.simulator.dataset.frames import Assets, simulate_frames
from perceptree.simulator.dataset.plan import DatasetPlan
from perceptree.simulator.dataset.scene_job import SceneJob, draw_scene
from perceptree.simulator.rendering.drive import GRAVITY_M_PER_S2, IMU_HZ, Drive, make_drive
from perceptree.simulator.scene.description import describe_scene
from perceptree.simulator.settings import CameraSettings, DriveSettings, SimulatorSettings
from perceptree.simulator.settings.presets import PRESETS
from perceptree.simulator.streams import Stream, stream

FRAMES = 6
AXIS_MIDDLE, AXIS_TOP = 3, 4


@pytest.fixture(scope="module")
def settings() -> SimulatorSettings:
    return dataclasses.replace(
        PRESETS["drive"].settings, camera=CameraSettings.of_size(320, 180), views_per_scene=FRAMES
    )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, settings, textures, prototypes) -> Path:
    """One short drive on disk: its folder, with the scene's shard."""
    folder = tmp_path_factory.mktemp("drive")
    for name in ("images", "depth", "depth8", "depth_exact", "scenes"):
        (folder / name).mkdir()
    job = SceneJob(folder, DatasetPlan(settings, 4), 1, FRAMES)
    assert draw_scene(job, Assets(textures, prototypes)) == FRAMES
    assert job.records()
    return folder


def drive_of(settings: SimulatorSettings, seed: int, frames: int) -> Drive:
    scene = describe_scene(settings, seed)
    assert scene.circuit is not None
    rng = stream(seed, Stream.DRIVE)
    return make_drive(rng, settings.drive, settings.camera, scene.terrain, scene.circuit, frames)


def records(dataset: Path) -> list[dict]:
    return json.loads((dataset / "scenes" / "000001.json").read_text())


def test_a_shorter_or_longer_drive_is_another_one_and_is_not_resumed(dataset: Path, settings):
    ends_m = [drive_of(settings, 4_000_001, frames).origin_m[20] for frames in (5, 600)]
    assert np.linalg.norm(ends_m[0] - ends_m[1]) > 0.01
    plan = DatasetPlan(settings, 4)
    finished = [bool(SceneJob(dataset, plan, 1, FRAMES + more).records()) for more in (-1, 0, 1)]
    assert finished == [False, True, False]
    views = DatasetPlan(dataclasses.replace(settings, drive=DriveSettings()), 4)
    assert len(SceneJob(dataset, views, 1, FRAMES - 1).records()) == FRAMES - 1


def test_points_of_a_stem_seen_from_several_poses_meet_in_one_place(dataset: Path):
    """Rays from all frames to an axis point of a stem meet in one world point."""
    rays: dict[tuple[int, int], list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
    for record in records(dataset):
        image, pose = record["image"], record["image"]["pose_world"]
        rotation, origin = np.array(pose["rotation"]), np.array(pose["origin_m"])
        assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        assert np.allclose(rotation[:, 2], image["up_camera"], atol=1e-5)
        camera = PinholeCamera.from_dict(image["camera"])
        for tree in record["annotations"]:
            points = np.array(tree["keypoints"]).reshape(5, 3)
            for which in (AXIS_MIDDLE, AXIS_TOP):
                if points[which, 2] > 0:
                    pixel = opencv_to_image(points[which, :2])
                    ray = rotation.T @ pixels_to_rays(camera, pixel)
                    seen = (origin, ray / np.linalg.norm(ray), np.array([camera.fx]))
                    rays.setdefault((tree["stem"], which), []).append(seen)
    several = [found for found in rays.values() if len(found) >= 4]
    assert len(several) >= 2
    for found in several:
        origins, ways = (np.array([ray[part] for ray in found]) for part in (0, 1))
        across = np.eye(3) - ways[:, :, None] * ways[:, None]
        point = np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, origins))
        off_m = np.linalg.norm(np.einsum("nij,nj->ni", across, point - origins), axis=1)
        distance_m = np.linalg.norm(point - origins, axis=1)
        assert (off_m / distance_m * found[0][2]).max() < 0.5


def test_a_stem_keeps_its_number_and_its_truth(dataset: Path):
    truths: dict[int, set] = {}
    views: dict[int, int] = {}
    for record in records(dataset):
        numbers = [tree["stem"] for tree in record["annotations"]]
        assert len(set(numbers)) == len(numbers)
        for tree in record["annotations"]:
            truth = (*tree["position_world_m"], tree["diameter_m"], tree["cut_height_m"])
            truths.setdefault(tree["stem"], set()).add(truth)
            views[tree["stem"]] = views.get(tree["stem"], 0) + 1
    assert max(views.values()) >= FRAMES - 1
    assert all(len(found) == 1 for found in truths.values())


def test_frames_are_timed_and_the_imu_covers_them_without_a_gap(dataset: Path):
    images = [record["image"] for record in records(dataset)]
    assert [image["time_s"] for image in images] == pytest.approx([0.1 * n for n in range(FRAMES)])
    with (dataset / images[0]["imu_file"]).open() as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    times_s = np.array([row["time_s"] for row in rows])
    assert np.allclose(np.diff(times_s), 1 / IMU_HZ, atol=1e-6)
    assert times_s[-1] == pytest.approx(images[-1]["time_s"])


def test_a_frames_time_is_that_of_its_pose_at_any_frame_rate(settings):
    for rate_hz in (10.0, 15.0, 30.0):
        faster = dataclasses.replace(settings.drive, rate_hz=rate_hz)
        drive = drive_of(dataclasses.replace(settings, drive=faster), 4_000_002, 12)
        for number in range(12):
            row = round(drive.time_s(number) * IMU_HZ)
            assert drive.time_s(number) == pytest.approx(row / IMU_HZ, abs=1e-9)
            assert np.array_equal(drive.view(number).origin, drive.origin_m[row])
            assert drive.time_s(number) == pytest.approx(number / rate_hz, abs=0.5001 / IMU_HZ)


def test_turn_rates_carry_the_first_pose_to_the_last(settings):
    drive = drive_of(settings, 4_000_002, 60)
    rotation = drive.rotation[0]
    for rate in (drive.gyro_rad_per_s[:-1] + drive.gyro_rad_per_s[1:]) / 2:
        angle = rate / IMU_HZ
        size = np.linalg.norm(angle) + 1e-12
        axis = angle / size
        skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turn = np.eye(3) - np.sin(size) * skew + (1 - np.cos(size)) * skew @ skew
        rotation = turn @ rotation
    error = np.degrees(
        np.arccos(np.clip((np.trace(rotation @ drive.rotation[-1].T) - 1) / 2, -1, 1))
    )
    turned = np.degrees(np.abs(drive.gyro_rad_per_s).sum() / IMU_HZ)
    assert turned > 20
    assert error < 0.2


def test_acceleration_carries_the_first_place_to_the_last(settings):
    drive = drive_of(settings, 4_000_003, 60)
    world = np.einsum("nji,nj->ni", drive.rotation, drive.accel_m_per_s2)
    world = world - [0, 0, GRAVITY_M_PER_S2]
    velocity = np.gradient(drive.origin_m, 1 / IMU_HZ, axis=0)
    gained = np.cumsum(world[:-1], 0) / IMU_HZ
    assert np.abs(velocity[1:] - velocity[0] - gained)[5:-5].max() < 0.03


def test_a_machine_that_stands_still_measures_gravity_along_up(settings):
    still = dataclasses.replace(
        settings,
        drive=DriveSettings(
            10.0, speed_m_per_s=(0.05, 0.05), sway_deg=(0.0, 0.0), slew_deg=(0.0, 0.0)
        ),
    )
    drive = drive_of(still, 4_000_004, 20)
    up = drive.rotation[:, :, 2]
    assert np.allclose(drive.accel_m_per_s2, GRAVITY_M_PER_S2 * up, atol=0.25)


def test_no_stem_stands_in_the_machines_way(settings):
    scene = describe_scene(settings, 4_000_005)
    feet = np.array([tree.position_m[:2] for tree in scene.trees])
    assert scene.circuit.distance_m(feet).min() > settings.drive.clearance_m
    gaps_m = scene.circuit.distance_m(scene.obstacles[:, :2]) - scene.obstacles[:, 2]
    assert gaps_m.min() > 0.2


def test_one_camera_films_a_drive_and_another_one_the_next(
    dataset: Path, settings, textures, prototypes
):
    first, *more = (record["image"] for record in records(dataset))
    for name in ("realism", "depth_sensor"):
        assert all(image[name] == first[name] for image in more)
    (other,) = simulate_frames(settings, 4_000_006, 1, Assets(textures, prototypes))
    assert first["realism"]["exposure_stops"] != other.realism["exposure_stops"]
    assert first["realism"]["camera_faults"] != other.realism["camera_faults"]
    assert first["depth_sensor"]["noise"] != pytest.approx(other.depth_sensor["noise"], rel=0.01)
    assert first["depth_sensor"]["range_m"] != pytest.approx(
        other.depth_sensor["range_m"], rel=0.01
    )
