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
from basetree.errors import InputError
from edgetree.sources.bags.exact import EXACT_TOPIC, FILLED_TOPIC, exact_record
from edgetree.sources.bags.recording import open_recording
from edgetree.sources.bags.rvl import decode_rvl
from formats.form import Format

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))
import bag_files
import mcap_files
from mcap.writer import CompressionType
from packets import moving_pictures, rvl, video_packets

_ENCODINGS = ("bgr8", "nv12", "i420", "yuyv", "rgb16", "bayer_rggb16", "mono8")


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
            filled_m = frame.depth[:8].astype(np.float32)
            bag.image(FILLED_TOPIC, filled_m, stamp, "32FC1", height=8)
            bag.image(bag_files.DEPTH, frame.depth[:8], stamp, "16UC1", height=8)
        return bag.file.read_bytes()


def _pictures() -> bytes:
    """A recording with pictures of all kinds of encodings, RVL depth and video."""
    with tempfile.TemporaryDirectory() as name:
        with bag_files.BagFile(Path(name)) as bag:
            frame, stamp = bag_files.small_frame(), bag_files.START_NS
            for number, encoding in enumerate(_ENCODINGS):
                values = np.zeros((2, 192), np.uint8)
                size = {"width": 4, "height": 2, "step": 0}
                bag.image(bag_files.COLOUR, values, stamp + number, encoding, **size)
            form = "16UC1; compressedDepth rvl"
            code = bytes(12) + rvl(frame.depth[:4])
            bag.packed(f"{bag_files.DEPTH}/compressedDepth", code, form, stamp)
        return bag.file.read_bytes()


def _video() -> bytes:
    """A recording with two packets of H.264."""
    with tempfile.TemporaryDirectory() as name:
        with bag_files.BagFile(Path(name)) as bag:
            for number, packet in enumerate(video_packets(moving_pictures(2))):
                bag.packed(bag_files.COLOUR, packet, "h264", bag_files.START_NS + 10**8 * number)
        return bag.file.read_bytes()


def _read_rvl(path: Path) -> object:
    try:
        return decode_rvl(path.read_bytes())
    except ValueError as error:  # what the reader of recordings names and counts
        raise InputError(str(error)) from error


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
    "recording.bag": Format((_recording("ros1"), _recording("ros1")[:-40]), _read_recording),
    "recording.mcap": Format((_recording("mcap"), _pictures(), _video()), _read_recording),
    "depth.rvl": Format((rvl(bag_files.small_frame().depth),), _read_rvl),
    "recording.db3": Format((_recording("sqlite3"),), _read_recording),
    "foxglove.mcap": Format(_FOXGLOVE, _read_recording),
    "recording.mcap.zstd": Format((_packed(_recording("mcap")),), _read_recording),
}
