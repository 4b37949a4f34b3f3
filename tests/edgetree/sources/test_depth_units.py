"""Unit, kind and correction of the depth of recordings, drives and arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from edgetree.frames.rig import Rig
from edgetree.sources import frame_from_arrays, open_frames, open_live_source

CAMERA = calib.PinholeCamera(640, 360, 400.0, 400.0, 319.5, 179.5)
DEPTH_M = np.tile(np.linspace(3.9, 4.1, 640, dtype=np.float32), (360, 1))
SCALE = calib.DepthScale(1.25, 0.0, 0.001, 0.002, -0.9, 0.5, 4.0)


def test_recordings_and_drives_take_them(bags: Any, tmp_path: Path, write_drive: Any) -> None:
    frame = bags.small_frame()
    depth_m = frame.depth / np.float32(1000)
    ranges_m = calib.depth_to_range(depth_m, frame.camera)
    forms = {
        "unit": (np.rint(depth_m * 5000).astype(np.uint16), "16UC1", Rig(depth_scale_m=0.0002)),
        "scale": (frame.depth, "16UC1", Rig(depth_scale_m=None, depth_calibration=SCALE)),
        "range": (ranges_m, "32FC1", Rig(depth_kind="range")),
    }
    for name, (values, encoding, rig) in forms.items():
        with bags.BagFile(tmp_path, name=name) as bag:
            bag.image(bags.COLOUR, frame.image, bags.START_NS)
            bag.image(bags.DEPTH, values, bags.START_NS, encoding)
            bag.info(bags.INFO, frame.camera, bags.START_NS)
        factor = 1.25 if name == "scale" else 1
        for opened in (open_live_source(str(bag.path), rig=rig), open_frames(bag.path, rig=rig)):
            (read,) = opened
            np.testing.assert_allclose(read.depth_m, depth_m * factor, rtol=1e-3)
    drive = write_drive(frames=1)
    (usual,), (half,) = open_frames(drive), open_frames(drive, depth_scale_m=0.0005)
    np.testing.assert_allclose(half.depth_m, usual.depth_m / 2, rtol=1e-6)
    (ranged,) = open_live_source(str(drive), rig=Rig(depth_kind="range"))
    np.testing.assert_allclose(
        ranged.depth_m, calib.range_to_depth(usual.depth_m, usual.camera), rtol=1e-6
    )


def test_a_range_without_a_camera_is_named(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
        bag.image(bags.DEPTH, frame.depth, bags.START_NS, "16UC1")
    with pytest.raises(calib.DepthError, match="is a range along the rays: expected the camera"):
        list(open_frames(bag.path, rig=Rig(depth_kind="range")))
    (read,) = open_frames(bag.path, rig=Rig(depth_kind="range", camera=frame.camera))
    expected = calib.range_to_depth(frame.depth / np.float32(1000), frame.camera)
    np.testing.assert_allclose(read.depth_m, expected, rtol=1e-5)


def test_arrays_take_them() -> None:
    steps = np.rint(DEPTH_M * 5000).astype(np.int32)
    frame = frame_from_arrays(0, 0.0, None, steps, depth_scale_m=0.0002)
    np.testing.assert_allclose(frame.depth_m, DEPTH_M, atol=2e-4)
    frame = frame_from_arrays(0, 0.0, None, DEPTH_M / 1.25, depth_scale_m=SCALE)
    np.testing.assert_allclose(frame.depth_m, DEPTH_M, rtol=1e-5)
    ranges_m = calib.depth_to_range(DEPTH_M, CAMERA)
    frame = frame_from_arrays(0, 0.0, None, ranges_m, depth_kind="range", camera=CAMERA)
    np.testing.assert_allclose(frame.depth_m, DEPTH_M, rtol=1e-5)
