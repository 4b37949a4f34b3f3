"""The bag of standard messages, read with rosbags."""

import dataclasses
import json
import sys

import cv2
import numpy as np
import pytest

from basetree.errors import InputError, MissingPackage
from calib import PinholeCamera, RigidTransform
from edgetree.measure import Failure
from edgetree.sinks import BagSink


@pytest.fixture
def read():
    """A function that reads a bag: lists of (time in ns, message) by topic."""
    highlevel = pytest.importorskip("rosbags.highlevel")

    def read_bag(folder):
        found = {}
        with highlevel.AnyReader([folder]) as reader:
            for connection, time_ns, data in reader.messages():
                message = reader.deserialize(data, connection.msgtype)
                found.setdefault(connection.topic, []).append((time_ns, message))
        return found

    return read_bag


@pytest.fixture
def bag(tmp_path, live_result, read):
    """The messages of two frames of three stems, the last of them out of view."""
    # The camera looks along the map's y axis.
    pose = RigidTransform(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([5.0, 6.0, 1.5]))
    sink = BagSink(tmp_path / "drive")
    for number in (1, 2):
        sink.write(live_result(number, pose=pose, time_s=1.7e9 + number / 10))
    sink.close()
    sink.close()
    return read(tmp_path / "drive")


def test_every_frame_has_all_messages_at_its_time(bag) -> None:
    assert {topic: len(messages) for topic, messages in bag.items()} == dict.fromkeys(
        (
            "/edgetree/image/compressed",
            "/edgetree/camera_info",
            "/tf",
            "/edgetree/detections",
            "/edgetree/markers",
            "/edgetree/json",
        ),
        2,
    )
    for topic in ("/edgetree/image/compressed", "/edgetree/detections"):
        time_ns, message = bag[topic][1]
        stamp = message.header.stamp
        assert time_ns == stamp.sec * 10**9 + stamp.nanosec
        assert time_ns / 1e9 == pytest.approx(1.7e9 + 0.2, abs=1e-6)


@pytest.mark.parametrize("from_s", [3.99e9, 6.39e10, -3600.0])
def test_stamps_beyond_those_of_ros_keep_their_differences(
    tmp_path, live_result, read, from_s: float
) -> None:
    with BagSink(tmp_path / "drive") as sink:
        for number in (1, 2):
            sink.write(live_result(number, time_s=from_s + number / 4))
    stamps = [
        message.header.stamp for _, message in read(tmp_path / "drive")["/edgetree/detections"]
    ]
    first, second = (stamp.sec + stamp.nanosec / 1e9 for stamp in stamps)
    assert second - first == pytest.approx(0.25, abs=1e-4)


def test_picture_camera_and_record_are_those_of_the_frame(bag) -> None:
    image = cv2.imdecode(bag["/edgetree/image/compressed"][0][1].data, cv2.IMREAD_COLOR)
    assert image.shape == (360, 640, 3)
    camera = bag["/edgetree/camera_info"][0][1]
    assert (camera.width, camera.height, camera.distortion_model) == (640, 360, "plumb_bob")
    assert camera.k.tolist() == [400, 0, 319.5, 0, 400, 179.5, 0, 0, 1]
    assert camera.p.tolist() == [400, 0, 319.5, 0, 0, 400, 179.5, 0, 0, 0, 1, 0]
    assert json.loads(bag["/edgetree/json"][0][1].data)["schema"] == "edgetree.live/1"


def test_stems_in_view_are_detections_upright_on_their_place(bag) -> None:
    detections = bag["/edgetree/detections"][0][1]
    assert detections.header.frame_id == "edgetree_camera"
    assert [one.id for one in detections.detections] == ["1", "2"]
    first = detections.detections[0]
    assert first.results[0].hypothesis.class_id == "tree"
    assert first.results[0].hypothesis.score == pytest.approx(0.9)
    place = first.results[0].pose.pose.position
    assert (place.x, place.y, place.z) == (-0.5, 1.6, 3.0)
    centre, size = first.bbox.center, first.bbox.size
    assert (centre.position.x, centre.position.y) == pytest.approx((-0.5, 1.6 - 0.65))
    assert (size.x, size.y, size.z) == pytest.approx((0.211, 0.211, 1.3))
    q = centre.orientation
    turned = RigidTransform.from_quaternion((q.x, q.y, q.z, q.w), np.zeros(3))
    assert turned.rotation @ [0, 0, 1] == pytest.approx([0, -1, 0])  # up in the camera's frame


def test_the_covariance_is_turned_into_the_cameras_frame(bag) -> None:
    pose = bag["/edgetree/detections"][0][1].detections[0].results[0].pose
    variances = pose.covariance.reshape(6, 6).diagonal()[:3]
    # In the map 3, 5 and 2 cm; the map's y is the camera's z, its z the camera's -y.
    assert np.sqrt(variances) == pytest.approx([0.03, 0.02, 0.05])


def test_the_pose_takes_the_camera_into_the_map(bag) -> None:
    (stamped,) = bag["/tf"][0][1].transforms
    assert (stamped.header.frame_id, stamped.child_frame_id) == ("edgetree_map", "edgetree_camera")
    q, t = stamped.transform.rotation, stamped.transform.translation
    pose = RigidTransform.from_quaternion((q.x, q.y, q.z, q.w), (t.x, t.y, t.z))
    assert pose.apply(np.array([0.0, 0.0, 2.0])) == pytest.approx([5.0, 8.0, 1.5])


def test_all_stems_have_a_marker_with_their_diameter(bag) -> None:
    markers = bag["/edgetree/markers"][0][1].markers
    assert [one.action for one in markers] == [3, 0, 0, 0, 0, 0, 0]  # delete all, then add
    assert [one.type for one in markers[1:]] == [3, 9] * 3
    assert len({one.id for one in markers}) == 7
    assert markers[2].text == "1: 21.1 ± 0.6 cm"
    assert markers[5].color.a < markers[1].color.a  # out of view


@pytest.mark.parametrize(
    ("distortion", "kind", "model", "terms"),
    [
        ((0.1, 0.02, 0.0, 0.0, 0.01, 0.1, 0.1, 0.1), "radtan", "rational_polynomial", 8),
        ((0.1, 0.02, 0.0, 0.0), "radtan", "plumb_bob", 5),
        ((0.1, 0.02, 0.0, 0.0), "fisheye", "equidistant", 4),
    ],
)
def test_distortion_has_the_names_of_ros(
    tmp_path, live_result, read, distortion, kind: str, model: str, terms: int
) -> None:
    camera = PinholeCamera(640, 360, 400.0, 400.0, 319.5, 179.5, distortion, kind)
    result = live_result(diameter_m=Failure("hidden"))
    frame = dataclasses.replace(result.frame, camera=camera, image=None)
    sink = BagSink(tmp_path / "drive")
    sink.write(dataclasses.replace(result, frame=frame))
    sink.close()
    messages = read(tmp_path / "drive")
    told = messages["/edgetree/camera_info"][0][1]
    assert (told.distortion_model, len(told.d)) == (model, terms)
    assert tuple(told.d[:4]) == distortion[:4]
    assert "/edgetree/image/compressed" not in messages
    assert "/tf" not in messages
    assert messages["/edgetree/markers"][0][1].markers[2].text == "1"


def test_an_existing_folder_is_kept(tmp_path) -> None:
    pytest.importorskip("rosbags")
    (tmp_path / "drive").mkdir()
    with pytest.raises(InputError, match="drive exists already"):
        BagSink(tmp_path / "drive")
    with pytest.raises(InputError, match="cannot be written"):
        BagSink(tmp_path / "none" / "drive")
    assert [entry.name for entry in tmp_path.iterdir()] == ["drive"]


def test_without_the_package_the_extra_is_named(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "rosbags", None)
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(MissingPackage, match="record"):
        BagSink(tmp_path / "drive")
