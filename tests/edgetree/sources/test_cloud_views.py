"""A cloud without a picture is seen by virtual cameras."""

import numpy as np
import pytest

from basetree.errors import InputError
from calib import PinholeCamera, RigidTransform
from edgetree.frames.rig import Rig
from edgetree.sources import open_source
from edgetree.sources.cloud_views import viewpoint_m

CAMERA = PinholeCamera(320, 240, fx=250.0, fy=250.0, cx=159.5, cy=119.5)


def room(origin=(0.0, 0.0, 0.0)):
    """Ground at z = -1.5 m within 12 m, with a post of 0.4 m at x = 5 m, around an origin."""
    ticks = np.arange(-12, 12, 0.1)
    x, y = (part.ravel() for part in np.meshgrid(ticks, ticks))
    ground = np.stack([x, y, np.full(len(x), -1.5)], -1)
    turn, height = np.meshgrid(np.linspace(0, 2 * np.pi, 80), np.arange(-1.5, 4, 0.02))
    post = np.stack([5 + 0.2 * np.cos(turn), 0.2 * np.sin(turn), height], -1).reshape(-1, 3)
    return np.concatenate([ground, post]) + origin


def test_a_scan_is_seen_all_around_from_its_origin(tmp_path):
    np.savez(tmp_path / "scan.npz", points=room())
    frames = list(open_source(tmp_path / "scan.npz"))
    assert [frame.name for frame in frames] == [f"scan_yaw{yaw:03d}" for yaw in range(0, 360, 60)]
    ahead = frames[0]
    middle = ahead.depth_m[200, ahead.camera.width // 2]
    assert middle == pytest.approx(4.8, abs=0.02)
    assert ahead.image is None
    assert ahead.up_camera.tolist() == [0.0, -1.0, 0.0]
    np.testing.assert_allclose(ahead.pose.translation_m, 0, atol=1e-9)
    opposite = frames[3].depth_m
    assert not np.count_nonzero(opposite[:230])  # above the horizon


def test_a_place_of_its_own_has_room_and_stands_above_the_ground():
    place = viewpoint_m(room(origin=(500_000.0, 6_000_000.0, 200.0)))
    assert place[2] == pytest.approx(198.5 + 1.6, abs=0.2)
    assert np.hypot(*(place[:2] - (500_005.0, 6_000_000.0))) > 1.0


def test_a_place_among_stems_without_ground_is_as_high_above_their_feet():
    rng = np.random.default_rng(0)
    stems = [(5.0, 0.0), (8.0, 4.0), (3.0, 6.0), (9.0, -3.0)]
    parts = []
    for x, y in stems:
        turn, z = rng.uniform(0, 2 * np.pi, 4000), rng.uniform(200.0, 230.0, 4000)
        parts.append(np.stack([x + 0.15 * np.cos(turn), y + 0.15 * np.sin(turn), z], -1))

    place = viewpoint_m(np.concatenate(parts))

    assert place[2] == pytest.approx(200.0 + 1.6, abs=0.3)


def test_a_camera_of_its_own_sees_one_view(tmp_path):
    np.savez(tmp_path / "scan.npz", points=room())
    mounting = RigidTransform.mounting([2.0, 0.0, 0.0])
    rig = Rig(camera=CAMERA, cloud_extrinsics=mounting.inverse())
    (frame,) = open_source(tmp_path / "scan.npz", rig=rig)
    depth_m = frame.depth_m if frame.filled_depth_m is None else frame.filled_depth_m
    assert depth_m[100, 160] == pytest.approx(2.8, abs=0.02)


def test_a_camera_needs_its_place(tmp_path):
    np.savez(tmp_path / "scan.npz", points=room())
    with pytest.raises(InputError, match="--camera given without --extrinsic for cloud"):
        open_source(tmp_path / "scan.npz", rig=Rig(camera=CAMERA))


@pytest.mark.parametrize(
    ("given", "option"),
    [({"depth_scale_m": 0.5}, "--depth-scale"), ({"depth_kind": "range"}, "--depth-kind")],
)
def test_what_is_said_of_depth_images_is_refused(tmp_path, given, option):
    np.savez(tmp_path / "scan.npz", points=room())
    with pytest.raises(InputError, match=f"{option} is given for cloud"):
        open_source(tmp_path / "scan.npz", rig=Rig(**given))
    placed = Rig(camera=CAMERA, cloud_extrinsics=RigidTransform.identity(), **given)
    with pytest.raises(InputError, match=f"{option} is given for cloud"):
        placed.read_beams(tmp_path / "scan.npz", (CAMERA.width, CAMERA.height))


def test_an_origin_at_the_edge_is_not_the_scanner():
    place = viewpoint_m(room(origin=(11.0, 11.0, 0.0)))
    assert np.hypot(*(place[:2] - 11.0)) < 8.0


def test_points_of_the_machine_do_not_hide_the_scanner():
    machine = np.random.default_rng(0).uniform(-0.4, 0.4, (700, 3))
    assert viewpoint_m(np.concatenate([room(), machine])).tolist() == [0.0, 0.0, 0.0]


def test_views_without_points_are_passed_over(tmp_path, caplog):
    points = room()
    np.savez(tmp_path / "ahead.npz", points=points[points[:, 0] > 0.5 + 2 * abs(points[:, 1])])
    frames = list(open_source(tmp_path / "ahead.npz"))
    assert 0 < len(frames) < 6
    assert "shows hardly any point of the cloud: left out" in caplog.text
