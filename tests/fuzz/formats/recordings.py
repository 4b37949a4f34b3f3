"""Recordings of ROS."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import zstandard

import calib
from edgetree.sources.bags.exact import EXACT_TOPIC, exact_record
from edgetree.sources.bags.recording import open_recording
from formats.form import Format

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))
import bag_files
import mcap_files
from mcap.writer import CompressionType


def _recording(kind: str) -> bytes:
    """A recording with a frame of colour and depth, camera, gravity and pose."""
    with tempfile.TemporaryDirectory() as name:
        with bag_files.BagFile(Path(name), kind) as bag:
            frame, stamp = bag_files.small_frame(), bag_files.START_NS
            bag.info(bag_files.INFO, frame.camera, stamp)
            bag.tf("odom", bag_files.FRAME, calib.RigidTransform.identity(), stamp)
            bag.imu("/imu", (0, -9.8, 0), stamp, bag_files.FRAME)
            exact = json.dumps(exact_record(stamp, frame.camera, np.array([0.0, -1.0, 0.0])))
            kind_of_text = "std_msgs/msg/String"
            bag.write(EXACT_TOPIC, kind_of_text, bag.message(kind_of_text, data=exact), stamp)
            jpeg = cv2.imencode(".jpg", frame.image)[1].tobytes()
            bag.packed(f"{bag_files.COLOUR}/compressed", jpeg, "jpeg", stamp)
            bag.image(bag_files.DEPTH, frame.depth[:8], stamp, "16UC1", height=8)
        return bag.file.read_bytes()


def _read_recording(path: Path) -> list[object]:
    return list(open_recording(path))


def _packed(data: bytes) -> bytes:
    return zstandard.ZstdCompressor().compress(data)


def _foxglove(write: Callable[..., None]) -> bytes:
    """A recording with a picture of Foxglove."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "a.mcap")
        with mcap_files.McapOf(path, compression=CompressionType.NONE) as mcap:
            png = cv2.imencode(".png", bag_files.small_frame().image)[1].tobytes()
            common = {"format": "png", "data": png, "frame_id": "cam"}
            write(mcap, "/image", "CompressedImage", bag_files.START_NS, **common)
        return path.read_bytes()


_FOXGLOVE = (_foxglove(mcap_files.foxglove_json), _foxglove(mcap_files.foxglove_protobuf))

FORMATS = {
    "recording.bag": Format((_recording("ros1"),), _read_recording),
    "recording.mcap": Format((_recording("mcap"),), _read_recording),
    "recording.db3": Format((_recording("sqlite3"),), _read_recording),
    "foxglove.mcap": Format(_FOXGLOVE, _read_recording),
    "recording.mcap.zstd": Format((_packed(_recording("mcap")),), _read_recording),
}
