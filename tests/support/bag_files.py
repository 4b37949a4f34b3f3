"""Write small recordings of all three kinds, with the writers of rosbags."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np

import calib

KINDS = ("ros1", "sqlite3", "mcap")
COLOUR, DEPTH, INFO = "/cam/color/image_raw", "/cam/depth/image_raw", "/cam/color/camera_info"
FRAME = "cam_optical"
PERIOD_NS = 100_000_000
START_NS = 1_700_000_000_000_000_000


class BagFile:
    """Writes one recording; its methods make messages of the right types and write them."""

    def __init__(self, folder: Path, kind: str = "mcap", name: str = "drive") -> None:
        from rosbags import rosbag1, rosbag2
        from rosbags.rosbag2.enums import StoragePlugin
        from rosbags.typesys import Stores, get_typestore

        self.is_ros1 = kind == "ros1"
        latest = get_typestore(Stores.LATEST)
        self.store = get_typestore(Stores.ROS1_NOETIC) if self.is_ros1 else latest
        if self.is_ros1:
            self.path = folder / f"{name}.bag"
            self.store.register({TF: latest.fielddefs[TF]})
            self._writer: Any = rosbag1.Writer(self.path)
        else:
            self.path = folder / name
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self._writer = rosbag2.Writer(self.path, version=9, storage_plugin=plugin)
        self.kind = kind
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> BagFile:
        self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    @property
    def file(self) -> Path:
        """The file with the messages."""
        if self.is_ros1:
            return self.path
        return next(path for path in self.path.iterdir() if path.suffix in (".mcap", ".db3"))

    def message(self, kind: str, **values: Any) -> Any:
        return self.store.types[kind](**values)

    def header(self, stamp: int, frame: str) -> Any:
        time = self.message(
            "builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9
        )
        extra = {"seq": 0} if self.is_ros1 else {}
        return self.message("std_msgs/msg/Header", stamp=time, frame_id=frame, **extra)

    def add_topic(self, topic: str, kind: str) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self.store
            )

    def write(self, topic: str, kind: str, message: Any, log_ns: int) -> None:
        self.add_topic(topic, kind)
        encode = self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr
        self._writer.write(self._connections[topic], log_ns, bytes(encode(message, kind)))

    def image(
        self,
        topic: str,
        pixels: np.ndarray,
        stamp: int,
        encoding: str = "bgr8",
        frame: str = FRAME,
        **changed: Any,
    ) -> None:
        channels = 1 if pixels.ndim == 2 else pixels.shape[2]
        values = {
            "header": self.header(stamp, frame),
            "height": pixels.shape[0],
            "width": pixels.shape[1],
            "encoding": encoding,
            "is_bigendian": 0,
            "step": pixels.shape[1] * channels * pixels.itemsize,
            "data": np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8),
        }
        log_ns = changed.pop("log_ns", stamp)
        message = self.message("sensor_msgs/msg/Image", **(values | changed))
        self.write(topic, "sensor_msgs/msg/Image", message, log_ns)

    def packed(self, topic: str, data: bytes, form: str, stamp: int, frame: str = FRAME) -> None:
        kind = "sensor_msgs/msg/CompressedImage"
        content = np.frombuffer(data, np.uint8)
        header = self.header(stamp, frame)
        self.write(topic, kind, self.message(kind, header=header, format=form, data=content), stamp)

    def info(
        self,
        topic: str,
        camera: calib.PinholeCamera,
        stamp: int,
        frame: str = FRAME,
        **changed: Any,
    ) -> None:
        region = self.message(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        k = [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]
        p = changed.pop("p", [*k[:3], 0, *k[3:6], 0, *k[6:], 0])
        d = list(camera.distortion) or [0.0] * 5
        matrices = {"k": k, "d": d, "r": np.eye(3).ravel(), "p": p}
        named = {
            (name.upper() if self.is_ros1 else name): np.array(values, np.float64)
            for name, values in matrices.items()
        }
        values = {
            "header": self.header(stamp, frame),
            "height": camera.height,
            "width": camera.width,
            "distortion_model": "plumb_bob",
            "binning_x": 0,
            "binning_y": 0,
            "roi": region,
            **named,
        }
        kind = "sensor_msgs/msg/CameraInfo"
        self.write(topic, kind, self.message(kind, **(values | changed)), stamp)

    def imu(
        self,
        topic: str,
        acceleration: Any,
        stamp: int,
        frame: str = "imu",
        turn_rad_per_s: Any = (0.0, 0.0, 0.0),
        log_ns: int | None = None,
    ) -> None:
        kind, zero = "sensor_msgs/msg/Imu", np.zeros(9)
        message = self.message(
            kind,
            header=self.header(stamp, frame),
            orientation=self.quaternion((0, 0, 0, 1)),
            orientation_covariance=zero,
            angular_velocity=self.vector(turn_rad_per_s),
            angular_velocity_covariance=zero,
            linear_acceleration=self.vector(acceleration),
            linear_acceleration_covariance=zero,
        )
        self.write(topic, kind, message, stamp if log_ns is None else log_ns)

    def tf(
        self,
        parent: str,
        child: str,
        transform: calib.RigidTransform,
        stamp: int,
        topic: str = "/tf",
        quaternion: Any = None,
        log_ns: int | None = None,
        kind: str = "tf2_msgs/msg/TFMessage",
    ) -> None:
        xyzw = quaternion_of(transform.rotation) if quaternion is None else quaternion
        entry = self.message(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=self.message(
                "geometry_msgs/msg/Transform",
                translation=self.vector(transform.translation_m),
                rotation=self.quaternion(xyzw),
            ),
        )
        message = self.message(kind, transforms=[entry])
        self.write(topic, kind, message, stamp if log_ns is None else log_ns)

    def vector(self, xyz: Any) -> Any:
        x, y, z = (float(value) for value in xyz)
        return self.message("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def quaternion(self, xyzw: Any) -> Any:
        x, y, z, w = (float(value) for value in xyzw)
        return self.message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


TF = "tf2_msgs/msg/TFMessage"


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """(4,) x, y, z, w of a rotation of less than 180 degrees."""
    w = np.sqrt(max(0.0, 1 + np.trace(rotation))) / 2
    skew = rotation - rotation.T
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0], 4 * w * w]) / (4 * w)


def depth_png(values: np.ndarray) -> bytes:
    return bytes(12) + cv2.imencode(".png", values)[1].tobytes()


def small_frame(shade: int = 0) -> SimpleNamespace:
    """A picture of 64x48 px, depth of 2 to 6 m as uint16 millimetres, and their camera."""
    rows, columns = np.mgrid[:48, :64]
    image = np.stack([rows * 4, columns * 3, (rows + columns + shade) % 256], -1).astype(np.uint8)
    depth = (2000 + 60 * columns + shade).astype(np.uint16)
    return SimpleNamespace(
        image=image, depth=depth, camera=calib.PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5)
    )
