"""Messages that are not ROS 2's: ROS 1 and Foxglove in MCAP, and RealSense's own recordings."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib
from basetree.errors import InputError
from edgetree.sources.bags.recording import open_recording

pytest.importorskip("rosbags")
pytest.importorskip("mcap_protobuf")
import bag_files as bags
import mcap_files
from mcap.writer import CompressionType

COMPRESSIONS = [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD]


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_ros_1_messages_in_mcap(tmp_path: Path, compression: CompressionType) -> None:
    path = tmp_path / "a.mcap"
    with mcap_files.Ros1InMcap(path, compression=compression, chunk_size=20_000) as bag:
        for number in range(4):
            frame, stamp = bags.small_frame(number), bags.START_NS + number * bags.PERIOD_NS
            bag.image(bags.COLOUR, frame.image, stamp)
            bag.image(bags.DEPTH, frame.depth, stamp, "16UC1")
            bag.info(bags.INFO, frame.camera, stamp)
            bag.tf("odom", bags.FRAME, calib.RigidTransform.identity(), stamp)
    frames = list(open_recording(path))
    assert len(frames) == 4
    np.testing.assert_array_equal(frames[2].image, bags.small_frame(2).image)
    np.testing.assert_allclose(frames[2].depth_m, bags.small_frame(2).depth / 1000)
    assert frames[2].camera == bags.small_frame().camera
    assert frames[2].pose is not None


def foxglove_drive(path: Path, write: Any) -> Path:
    frame = bags.small_frame()
    camera = frame.camera
    k = [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]
    p = [*k[:3], 0, *k[3:6], 0, *k[6:], 0]
    depth = {"width": 64, "height": 48, "encoding": "16UC1", "step": 128}
    calibration = {"width": 64, "height": 48, "distortion_model": "plumb_bob"}
    calibration |= {"D": [0.0] * 5, "K": k, "R": np.eye(3).ravel().tolist(), "P": p}
    with mcap_files.McapOf(path) as mcap:
        for number in range(3):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            jpeg = cv2.imencode(".png", frame.image)[1].tobytes()
            link = {"frame_id": "cam"}
            write(mcap, "/cam/image", "CompressedImage", stamp, format="png", data=jpeg, **link)
            write(
                mcap, "/cam/depth", "RawImage", stamp, data=frame.depth.tobytes(), **depth, **link
            )
            write(mcap, "/cam/camera_info", "CameraCalibration", stamp, **calibration, **link)
    return path


@pytest.mark.parametrize("write", [mcap_files.foxglove_json, mcap_files.foxglove_protobuf])
def test_foxgloves_messages(tmp_path: Path, write: Any) -> None:
    frames = list(open_recording(foxglove_drive(tmp_path / "a.mcap", write)))
    assert len(frames) == 3
    assert frames[1].time_s == pytest.approx((bags.START_NS + bags.PERIOD_NS) / 1e9)
    np.testing.assert_array_equal(frames[1].image, bags.small_frame().image)
    np.testing.assert_allclose(frames[1].depth_m, bags.small_frame().depth / 1000)
    assert frames[1].camera == bags.small_frame().camera


def test_transforms_of_foxglove(tmp_path: Path) -> None:
    path = foxglove_drive(tmp_path / "a.mcap", mcap_files.foxglove_json)
    link = {"parent_frame_id": "odom", "child_frame_id": "cam"}
    link |= {"translation": {"x": 1.0, "y": 2.0, "z": 3.0}}
    link |= {"rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    with mcap_files.McapOf(path) as mcap:
        stamp = bags.START_NS
        png = cv2.imencode(".png", bags.small_frame().image)[1].tobytes()
        one = {"timestamp": {"sec": stamp // 10**9, "nsec": 0}, **link}
        mcap_files.foxglove_json(mcap, "/tf", "FrameTransforms", stamp, transforms=[one])
        mcap_files.foxglove_json(
            mcap, "/image", "CompressedImage", stamp, format="png", data=png, frame_id="cam"
        )
    (frame,) = open_recording(path)
    np.testing.assert_allclose(frame.pose.translation_m, [1, 2, 3])


@pytest.mark.parametrize(
    "changed",
    [
        {"timestamp": 5},
        {"timestamp": {"sec": 10**400, "nsec": 0}},
        {"timestamp": {"sec": -1, "nsec": 0}},
        {"data": 5},
        {"data": "no base64"},
        {"frame_id": None, "format": 7},
        {"data": None},
    ],
)
def test_fields_of_another_kind_do_no_harm(tmp_path: Path, changed: dict[str, Any]) -> None:
    path = tmp_path / "a.mcap"
    with mcap_files.McapOf(path) as mcap:
        png = cv2.imencode(".png", bags.small_frame().image)[1].tobytes()
        common = {"format": "png", "data": png, "frame_id": "cam"}
        for number, fields in enumerate([common, common | changed]):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            mcap_files.foxglove_json(mcap, "/image", "CompressedImage", stamp, **fields)
    assert 1 <= len(list(open_recording(path))) <= 2


def test_other_messages_are_named_with_their_encoding(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with mcap_files.McapOf(path) as mcap:
        mcap.add("/camera", ("my.Image", "protobuf", b""), "protobuf", b"", bags.START_NS)
    with pytest.raises(InputError, match=r"/camera \(my\.Image"):
        open_recording(path)


class SdkBag(bags.BagFile):
    """A recording as RealSense's SDK writes it, with the depth's unit after the pixels."""

    def __init__(self, folder: Path, trailing: bytes) -> None:
        super().__init__(folder, "ros1")
        self.trailing = trailing

    def write(self, topic: str, kind: str, message: Any, log_ns: int) -> None:
        self.add_topic(topic, kind)
        data = bytes(self.store.serialize_ros1(message, kind))
        data += self.trailing if kind.endswith("/Image") else b""
        self._writer.write(self._connections[topic], log_ns, data)

    def extrinsics(self, topic: str, x_m: float) -> None:
        kind = "geometry_msgs/msg/Transform"
        moved, turned = self.vector((x_m, 0, 0)), self.quaternion((0, 0, 0, 1))
        message = self.message(kind, translation=moved, rotation=turned)
        self.write(topic, kind, message, bags.START_NS)


@pytest.mark.parametrize("trailing", [b"", struct.pack("<f", 0.0001)])
def test_recordings_of_realsense(tmp_path: Path, trailing: bytes) -> None:
    depth_topic, colour_topic = "/device_0/sensor_0/Depth_0", "/device_0/sensor_1/Color_0"
    frame = bags.small_frame()
    with SdkBag(tmp_path, trailing) as bag:
        kind = "std_msgs/msg/Float32"
        unit = bag.message(kind, data=np.float32(0.0001))
        bag.write("/device_0/sensor_0/option/Depth Units/value", kind, unit, bags.START_NS)
        for topic, x_m in ((depth_topic, 0.0), (colour_topic, -0.5)):
            bag.info(f"{topic}/info/camera_info", frame.camera, bags.START_NS, "")
            bag.extrinsics(f"{topic}/tf/0", x_m)
        bag.image(
            f"{depth_topic}/image/data",
            np.full((48, 64), 40_000, np.uint16),
            bags.START_NS,
            "mono16",
            "",
        )
        bag.image(f"{colour_topic}/image/data", frame.image, bags.START_NS, "bgr8", "")
        bag.imu("/device_0/sensor_2/Accel_0/imu/data", (0, -9.8, 0), bags.START_NS, "1")
    (live,) = open_recording(bag.path)
    # 4 m by its own unit, seen by a colour camera half a metre to the right: 60 * 0.5 / 4 px left.
    seen = live.depth_m[24] > 0
    np.testing.assert_allclose(live.depth_m[24][seen], 4.0, rtol=1e-6)
    assert seen[:50].all()
    assert not seen[58:].any()
    np.testing.assert_allclose(live.up_camera, [0, -1, 0], atol=1e-6)
