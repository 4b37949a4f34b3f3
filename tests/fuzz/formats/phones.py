"""Captures of phones."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from calib import PinholeCamera
from edgetree.sources.phones import stray
from edgetree.sources.phones.lzfse import unpacked_bytes
from edgetree.sources.phones.opening import open_capture
from formats.form import Format

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))
from phone_captures import record3d_files, zipped

_SMALL = PinholeCamera(36, 48, 40.0, 40.0, 17.5, 23.5)
_ODOMETRY = b"""timestamp, frame, x, y, z, qx, qy, qz, qw
100.0, 000000, 0.0, 1.4, 0.0, 0.1, 0.0, 0.0, 0.995
100.1, 000001, 0.1, 1.4, 0.0, 0.1, 0.0, 0.0, 0.995
"""
_CONFIDENCE = cv2.imencode(".png", np.full((6, 8), 2, np.uint8))[1].tobytes()
_LZFSE = b"bvx-\x04\0\0\0abcdbvxn\x08\0\0\0\x02\0\0\0xxbvx$"


def _capture(path: Path) -> object:
    named = path.with_suffix(".r3d")
    path.replace(named)
    try:
        return list(open_capture(named))
    finally:
        named.replace(path)


FORMATS = {
    "odometry.csv": Format((_ODOMETRY,), stray.read_odometry),
    "confidence.png": Format((_CONFIDENCE,), stray.read_confidence),
    "lzfse": Format((_LZFSE,), lambda path: unpacked_bytes(path.read_bytes())),
}
if find_spec("lzfse"):
    FORMATS["capture.r3d"] = Format(
        (zipped(record3d_files(_SMALL, frames=1, depth_px=(9, 12))),), _capture
    )
