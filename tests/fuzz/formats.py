"""The formats that are read: small valid files of each, and the function that reads a path."""

from __future__ import annotations

import io
import json
import pickle
import socket
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from safetensors.torch import save

import calib
from basetree.files.reading import read_image
from edgetree.catalogue import default_model
from edgetree.check.csv_file import read_csv
from edgetree.live.page.access import Access
from edgetree.live.page.feed import Feed
from edgetree.live.page.handler import PageHandler
from edgetree.live.page.http_server import PageHttpServer
from edgetree.live.recording import FrameRecorder
from edgetree.model_file.manifest import Manifest
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.model_file.safety_check import read_model_file
from edgetree.runtime.providers import CPU, SessionSettings
from edgetree.runtime.session import OrtSession
from edgetree.signing import Statement, TrustedKey, TrustFile, parse_signature, read_public_key
from edgetree.signing.envelope import Envelope
from edgetree.signing.trust import read_trust_file, write_trust_file
from edgetree.sources.bags.exact import EXACT_TOPIC, exact_record
from edgetree.sources.bags.recording import open_recording
from perceptree.data.dataset import read_labels
from perceptree.data.layouts import LabelFile
from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.models import load_checkpoint, make_spec
from perceptree.models.weights.reading import read_weights
from perceptree.simulator import SimulatorSettings
from perceptree.simulator.settings.reading import read_settings
from perceptree.training.state import read_state

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
import bag_files

_ROS = b"""image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [526.69, 0, 312.33, 0, 525.75, 246.22, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.01, -0.02, 0, 0, 0]}
"""
_OPENCV = b"""%YAML:1.0
---
image_width: 1280
image_height: 720
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 905., 0., 640., 0., 904., 362., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.1, -0.2, 0., 0., 0. ]
"""
_XML = b"""<?xml version="1.0"?><opencv_storage><image_width>1280</image_width>
<image_height>720</image_height><cameraMatrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols>
<data>905. 0. 640. 0. 904. 362. 0. 0. 1.</data></cameraMatrix>
<distCoeffs type_id="opencv-matrix"><rows>5</rows><cols>1</cols><data>0.1 0 0 0 0</data>
</distCoeffs></opencv_storage>"""
_KALIBR = b"""cam0: {camera_model: pinhole, intrinsics: [400, 400, 320, 240],
  resolution: [640, 480], distortion_model: equidistant, distortion_coeffs: [0.01, 0, 0, 0]}"""
_ZED = (
    b"[LEFT_CAM_HD]\nfx=700\nfy=700\ncx=640\ncy=360\nk1=0.1\nk2=0\n\n"
    b"[LEFT_DISTO]\nk1=0.1\nk2=0\np1=0\np2=0\nk3=0\n"
)
_REALSENSE = b"[ 640x480  p[320 240]  f[600 600]  Brown Conrady [0 0 0 0 0] ]"
_OWN = b'{"schema": "calib.camera/1", "width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320,'
_OWN += b' "cy": 240, "distortion": [0.1, 0, 0, 0]}'
_TRANSFORM = b'{"schema": "calib.transform/1", "translation_m": [0, 0, 1], "roll_pitch_yaw_deg":'
_TRANSFORM += b" [0, 10, 0]}"
_REQUEST = (
    b"GET /events?token=0123456789abcdef HTTP/1.1\r\nHost: 127.0.0.1:8420\r\n"
    b"Cookie: a=b; edgetree_8420=0123456789abcdef\r\nSec-Fetch-Site: same-origin\r\n\r\n"
)
_MARK = _REQUEST.replace(b"GET /events", b"POST /mark").replace(
    b"Sec-Fetch-Site: same-origin",
    b"Origin: http://127.0.0.1:8420\r\nContent-Length: 14",
)
_MARK += b"wrong diameter"
_CSV = b"stem;diameter (cm);distance_m\n1;31,4;5\n2;20;\n"


_IDENTITY = {"settings": {"batch": 2}}


class Format(NamedTuple):
    """A kind of file.

    Attributes:
        seeds: valid files.
        read: the function that reads a path.
        refused: what the seeds are refused with, for formats whose valid files are too large.
    """

    seeds: tuple[bytes, ...]
    read: Callable[[Path], object]
    refused: str = ""


def _pictures() -> tuple[bytes, ...]:
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    return tuple(
        cv2.imencode(suffix, image)[1].tobytes()
        for suffix in (".png", ".jpg", ".tif", ".bmp", ".webp", ".ppm")
    )


def _model() -> bytes:
    return onnx_bytes(
        [Node("MatMul", ("x", "weights"), ("y",)), Node("Reshape", ("y", "n"), ("z",))],
        inputs={"x": TensorType("float32", ("batch", 4))},
        outputs={"z": TensorType("float32", ("batch", 3))},
        constants={"weights": np.ones((4, 3), np.float32), "n": np.array([1, 3])},
        metadata={"name": "small"},
    )


def _checkpoint() -> bytes:
    spec = make_spec("edge-n", "depth", 64, 128, fpn_width=16, box_head_width=16)
    record = {"schema": "perceptree.checkpoint/1", "spec": spec.to_dict(), "training": {}}
    return save({"weight": torch.ones(3)}, metadata={"perceptree": json.dumps(record)})


def _torch_bytes(content: Any, *, in_zip: bool = True) -> bytes:
    buffer = io.BytesIO()
    torch.save(content, buffer, _use_new_zipfile_serialization=in_zip)
    return buffer.getvalue()


def _weights() -> tuple[bytes, ...]:
    tensors = {"stem.weight": torch.ones(2, 3), "stem.bias": torch.zeros(2)}
    arrays = {"stem.weight": np.ones((2, 3), np.float32), "stem.bias": np.zeros(2)}
    return (
        _torch_bytes({"model": tensors}),
        _torch_bytes(tensors, in_zip=False),
        pickle.dumps({"model": arrays}, protocol=2),
        pickle.dumps(arrays, protocol=4),
    )


def _state() -> bytes:
    weight = torch.nn.Parameter(torch.ones(2))
    return _torch_bytes(
        {
            "model": {"weight": torch.ones(2)},
            "average": {"weight": torch.ones(2)},
            "optimizer": torch.optim.AdamW([weight]).state_dict(),
            "precision": "fp32",
            "step": 10,
            "first_step": 0,
            "stale": 0,
            "evaluated_at": -1,
            "elapsed_s": 12.5,
            "waited_s": 0.5,
            "means": {"total": 1.5},
            "version": 1,
            "best": {"box_ap": 50.0},
            "identity": json.dumps(_IDENTITY),
        }
    )


def _coco() -> bytes:
    size = {"width": 8, "height": 4}
    tree = {"image_id": 1, "category_id": 1, "iscrowd": 0, "area": 8}
    tree |= {"bbox": [1, 0, 2, 4], "keypoints": [1, 3, 2] * len(KEYPOINT_NAMES)}
    masks = [
        {"size": [4, 8], "counts": [4, 8, 20]},
        {"size": [4, 8], "counts": "48d0"},
        [[1, 0, 3, 0, 3, 4, 1, 4]],
    ]
    content = {
        "images": [{"id": 1, "file_name": "0.png", **size, "camera": {"fx": 500}}],
        "categories": [{"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES)}],
        "annotations": [
            tree | {"id": number, "segmentation": mask} for number, mask in enumerate(masks)
        ],
    }
    return json.dumps(content).encode()


def _signature() -> bytes:
    statement = Statement("small", 3, 100, "0" * 64, "2026-11-23T08:00:00Z", "2027-12-31T23:59:59Z")
    return Envelope(statement.to_json().encode(), "0" * 64, bytes(64)).to_json().encode()


def _public_key_and_trust() -> tuple[bytes, bytes]:
    key = Ed25519PrivateKey.from_private_bytes(bytes(32)).public_key()
    form = serialization.PublicFormat.SubjectPublicKeyInfo
    pem = key.public_bytes(serialization.Encoding.PEM, form)
    entry = TrustedKey.of(key.public_bytes_raw(), "office", "2027-12-31T23:59:59Z")
    with tempfile.TemporaryDirectory() as name:
        trust = Path(name, "trust.json")
        write_trust_file(trust, TrustFile(True, (entry,)))
        return pem, trust.read_bytes()


def _read_coco(path: Path) -> None:
    dataset = read_labels(LabelFile("train", None, False, path, path.parent))
    for frame in dataset.frames:
        for tree in frame.trees:
            if tree.segmentation:
                frame.mask(tree)


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


class _Recorder(FrameRecorder):
    """A recorder that writes nothing."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def mark(self, text: str = "") -> float:
        self.texts.append(json.dumps(text))
        return 5.0


@cache
def _page_server() -> PageHttpServer:
    """A server of the page that is about to close, so that streams end at once."""
    feed = Feed(stale_s=1.0, recorder=_Recorder())
    feed.close()
    access = Access("127.0.0.1", "0123456789abcdef")
    return PageHttpServer(("127.0.0.1", 0), PageHandler, access, feed, 1)


class _PageHandler(PageHandler):
    disable_nagle_algorithm = False  # which only TCP has


def _answer(path: Path) -> bytes:
    """The answer of the page's server to a request."""
    client, server = socket.socketpair()
    with client, server:
        client.sendall(path.read_bytes()[:100_000])
        client.shutdown(socket.SHUT_WR)
        _PageHandler(server, ("127.0.0.1", 1), _page_server())
        server.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: client.recv(65_536), b""))


def _open_model(path: Path) -> None:
    OrtSession(path, SessionSettings(CPU, threads=1))


def _formats() -> dict[str, Format]:
    depth = np.arange(12, dtype=np.uint16).reshape(3, 4)
    header = b"\x93NUMPY\x01\x00F\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }"
    manifest = read_model_file(default_model("depth")).metadata["edgetree.manifest"].encode()
    cameras = (_ROS, _OPENCV, _XML, _KALIBR, _ZED, _REALSENSE, _OWN)
    key, trust = _public_key_and_trust()
    settings = b'{"stand": {"stems_per_ha": [400, 500]}, "camera": {"mast_share": 0.5}}'
    return {
        "camera": Format(cameras, calib.load_camera),
        "transform": Format((_TRANSFORM,), calib.load_transform),
        "depth.png": Format((cv2.imencode(".png", depth)[1].tobytes(),), calib.read_depth),
        "depth.npy": Format((header.ljust(79) + b"\n" + bytes(16),), calib.read_depth),
        "picture": Format(_pictures(), read_image),
        "model.onnx": Format((_model(),), _open_model),
        "manifest": Format((manifest,), lambda path: Manifest.from_json(path.read_text("utf-8"))),
        "stems.csv": Format((_CSV,), read_csv),
        "checkpoint": Format((_checkpoint(),), load_checkpoint, refused="is missing"),
        "weights": Format(_weights(), read_weights),
        "request": Format((_REQUEST, _REQUEST.replace(b"events", b""), _MARK), _answer),
        "state": Format((_state(),), lambda path: read_state(path, _IDENTITY)),
        "coco.json": Format((_coco(),), _read_coco),
        "recording.bag": Format((_recording("ros1"),), _read_recording),
        "recording.mcap": Format((_recording("mcap"),), _read_recording),
        "recording.db3": Format((_recording("sqlite3"),), _read_recording),
        "signature": Format((_signature(),), lambda path: parse_signature(path.read_bytes())),
        "trust.json": Format((trust,), read_trust_file),
        "key.pub": Format((key,), read_public_key),
        "settings": Format((settings,), lambda path: read_settings(path, SimulatorSettings())),
    }


FORMATS = _formats()
