"""Point clouds of recordings are projected into the pictures of their cameras."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rosbags")
from bag_files import COLOUR, INFO, PERIOD_NS, START_NS, BagFile

from basetree.errors import InputError
from calib import PinholeCamera, RigidTransform
from edgetree.frames.rig import Rig
from edgetree.sources.bags.point_clouds import CloudDecoder
from edgetree.sources.bags.recording import open_recording

CAMERA = PinholeCamera(64, 48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
# The scanner, x ahead, y left, z up, is 7.5 cm above a level camera.
TO_CAMERA = RigidTransform(
    [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]], [0.025, -0.075, 0.0]
)
POINTS = np.array([[3.0, y / 10, z / 10] for y in range(-9, 10) for z in range(-7, 8)])
KIND = "sensor_msgs/msg/PointCloud2"


def values_of(order="<", padding=8):
    """A cloud of two rows with x, y, z and intensity, and bytes after each row, as drivers may."""
    rows = POINTS[: len(POINTS) // 2 * 2].reshape(2, -1, 3)
    data = b"".join(
        b"".join(struct.pack(f"{order}4xfffH2x", *point, 7) for point in row) + bytes(padding)
        for row in rows.tolist()
    )
    return {
        "height": 2,
        "width": rows.shape[1],
        "is_bigendian": order == ">",
        "point_step": 20,
        "row_step": 20 * rows.shape[1] + padding,
        "data": np.frombuffer(data, np.uint8),
        "is_dense": True,
    }


def fields(make):
    named = zip(("x", "y", "z", "intensity"), (4, 8, 12, 16), (7, 7, 7, 4), strict=True)
    return [make(name=name, offset=at, datatype=kind, count=1) for name, at, kind in named]


def record(bag, with_tf=True):
    for number in range(3):
        stamp = START_NS + number * PERIOD_NS
        if with_tf:
            bag.tf("cam_optical", "os_lidar", TO_CAMERA, stamp, topic="/tf_static")
        bag.info(INFO, CAMERA, stamp)
        bag.image(COLOUR, np.zeros((48, 64, 3), np.uint8), stamp)

        def field(**values):
            return bag.message("sensor_msgs/msg/PointField", **values)

        header = bag.header(stamp + 5_000_000, "os_lidar")
        message = bag.message(KIND, header=header, fields=fields(field), **values_of())
        bag.write("/points", KIND, message, stamp + 5_000_000)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_cloud_is_depth_of_its_beams(kind, tmp_path):
    with BagFile(tmp_path, kind) as bag:
        record(bag)
    frames = list(open_recording(bag.path, topics={"depth": "/points"}))
    assert len(frames) == 3
    depth_m = frames[0].depth_m
    # At 3 m, 2 px are 10 cm: the point straight ahead is half a pixel aside and 1.5 px up.
    assert depth_m[22, 32] == pytest.approx(3.0, abs=1e-5)
    assert depth_m[22, 33] == 0
    assert 200 < np.count_nonzero(depth_m) <= len(POINTS)
    assert np.count_nonzero(frames[0].filled_depth_m) > 2 * np.count_nonzero(depth_m)


def test_without_a_transform_it_is_asked_for(tmp_path, caplog):
    with BagFile(tmp_path) as bag:
        record(bag, with_tf=False)
    with pytest.raises(InputError, match=r"lack a transform to it \(--extrinsic\)"):
        list(open_recording(bag.path, topics={"depth": "/points"}))
    rig = Rig(camera=CAMERA, cloud_extrinsics=TO_CAMERA)
    assert len(list(open_recording(bag.path, topics={"depth": "/points"}, rig=rig))) == 3


def test_clouds_that_are_not_named_leave_a_recording_as_it_is(tmp_path):
    with BagFile(tmp_path) as bag:
        record(bag, with_tf=False)
    assert [frame.depth_m for frame in open_recording(bag.path)] == [None] * 3


def test_the_order_of_bytes_is_the_messages():
    message = SimpleNamespace(fields=fields(SimpleNamespace), **values_of(">"))
    cloud = CloudDecoder("/points").decode(message)
    np.testing.assert_allclose(cloud.points_m, POINTS[: len(POINTS) // 2 * 2], atol=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"row_step": 3}, "rows of 3"),
        ({"width": 2**31, "height": 2**31}, "limit cloud_points"),
        ({"point_step": 8, "row_step": 5000}, "points of 8 bytes"),
        ({"data": np.zeros(9, np.uint8)}, "it has 9 bytes"),
        ({"fields": []}, "expected x, y and z"),
        ({"width": 0}, "states 0x2 points"),
    ],
)
def test_messages_that_contradict_themselves_are_refused(change, words):
    values = {"fields": fields(SimpleNamespace), **values_of(), **change}
    with pytest.raises(InputError, match=f"a cloud of topic /points cannot be decoded: .*{words}"):
        CloudDecoder("/points").decode(SimpleNamespace(**values))
