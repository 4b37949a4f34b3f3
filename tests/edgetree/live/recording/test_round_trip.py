"""A recording gives the same frames, trees and metres as the source that was recorded."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from calib import PinholeCamera, RigidTransform
from edgetree.frames import Rig
from edgetree.frames.frame import DepthNoise
from edgetree.live import LivePipeline, LiveResult
from edgetree.results import live_record
from edgetree.runtime import TreeDetector, default_model
from edgetree.sources import open_live_source

WIDTH, HEIGHT = 64, 48
CAMERA = PinholeCamera(WIDTH, HEIGHT, 51.3, 52.7, 30.1, 22.9, focal_std_px=0.4)
RNG = np.random.default_rng(1)
IMAGE = RNG.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
STEPS = RNG.integers(0, 9000, (HEIGHT, WIDTH)).astype(np.uint16)
STEPS[:5] = 0
MILLIMETRES = STEPS.astype(np.float32) / np.float32(1000)
FLOATS = (STEPS * np.float32(0.00025)).astype(np.float32)


def turned(angle: float, axis: int = 0) -> RigidTransform:
    turn = [0.0, 0.0, 0.0]
    turn[axis] = np.degrees(angle)
    return RigidTransform.from_euler_deg(*turn, [3.1, -2.2, 1.7])


def up_at(number: int) -> np.ndarray:
    """A vertical that sways, as on a machine that drives."""
    up = np.array([0.1 * np.sin(number), -1.0, 0.2 * np.cos(number)])
    return up / np.linalg.norm(up)


FRAMES: dict[str, dict[str, Any]] = {
    "millimetres": {"image": IMAGE, "depth_m": MILLIMETRES, "camera": CAMERA},
    "floats": {"image": IMAGE, "depth_m": FLOATS, "camera": CAMERA},
    "far": {"depth_m": MILLIMETRES * np.float32(8), "camera": CAMERA},
    "without depth": {"image": IMAGE, "camera": CAMERA},
    "without colour": {"depth_m": MILLIMETRES, "camera": CAMERA},
    "without camera": {"image": IMAGE, "depth_m": MILLIMETRES},
    "radtan 4": {
        "image": IMAGE,
        "camera": dataclasses.replace(CAMERA, distortion=(0.1, -0.02, 1e-3, 2e-3)),
    },
    "radtan 8": {
        "image": IMAGE,
        "camera": dataclasses.replace(CAMERA, distortion=(0.1, -0.02, 1e-3, 2e-3, 0, 0.1, 0, 0)),
    },
    "fisheye": {
        "image": IMAGE,
        "camera": dataclasses.replace(
            CAMERA, distortion=(0.1, -0.02, 1e-3, 2e-3), distortion_model="fisheye"
        ),
    },
    "columns in Fortran's order": {"image": np.asfortranarray(IMAGE), "camera": CAMERA},
}


@pytest.mark.parametrize("kind", FRAMES)
def test_frames_come_back_byte_by_byte(kind, record, recordings, read, result) -> None:
    recorder = record(waits=True)
    written = [result(number, **FRAMES[kind]) for number in range(5)]
    for one in written:
        recorder.write(one)
    recorder.mark()
    recorder.close()
    (folder,) = recordings()
    found = read(folder)
    assert [frame.number for frame in found] == [0, 1, 2, 3, 4]
    for frame, expected in zip(found, (one.frame for one in written), strict=True):
        assert frame.time_s == expected.time_s
        for name in ("image", "depth_m"):
            values, wanted = getattr(frame, name), getattr(expected, name)
            assert (values is None) == (wanted is None)
            if wanted is not None:
                assert values.dtype == wanted.dtype
                assert values.tobytes() == wanted.tobytes()
        if expected.camera is None:
            assert frame.camera is None
            continue
        assert frame.camera == expected.camera


def test_frames_whose_depth_or_colour_is_missing_come_back_in_their_place(
    record, recordings, read, result
) -> None:
    """As when one of two cameras fails for a while."""
    both, kinds = FRAMES["millimetres"], ["both", "both", "colour", "colour", "depth", "both"]
    lacks = {"both": {}, "colour": {"depth_m": None}, "depth": {"image": None}}
    recorder = record(waits=True)
    for number, kind in enumerate(kinds):
        recorder.write(result(number, **(both | lacks[kind])))
    recorder.mark()
    recorder.close()
    found = [(f.number, f.image is None, f.depth_m is None) for f in read(recordings()[0])]
    assert found == [
        (number, kind == "depth", kind == "colour") for number, kind in enumerate(kinds)
    ]


@pytest.mark.parametrize("has_pose", [False, True])
def test_a_swaying_vertical_and_the_pose_come_back(
    has_pose: bool, record, recordings, read, result
) -> None:
    recorder = record(waits=True)
    angles = [0.0, 1e-7, np.pi / 2, np.pi - 1e-6, np.pi, -3.0]
    poses = [turned(angle, axis) for axis in range(3) for angle in angles]
    written = [
        result(number, up_camera=up_at(number), pose=pose if has_pose else None)
        for number, pose in enumerate(poses)
    ]
    for one in written:
        recorder.write(one)
    recorder.mark()
    recorder.close()
    found = read(recordings()[0])
    assert len(found) == len(written)
    for frame, expected in zip(found, (one.frame for one in written), strict=True):
        assert frame.up_camera.tolist() == expected.up_camera.tolist()
        if not has_pose:
            assert frame.pose is None
            continue
        assert frame.pose.rotation == pytest.approx(expected.pose.rotation, abs=1e-14)
        assert frame.pose.translation_m == pytest.approx(expected.pose.translation_m, abs=1e-14)


def test_what_the_rig_knows_is_recorded_with_frames_that_do_not(
    record, recordings, read, result
) -> None:
    recorder, bare = record(), result(0)
    rig = Rig(camera=CAMERA, up_camera=(0.0, -0.8, 0.6), rotation_deg=90)
    frame = rig.completed(bare.frame, bare.trees.image_width, bare.trees.image_height)
    recorder.write(dataclasses.replace(bare, frame=frame))
    recorder.mark()
    recorder.close()
    (frame,) = read(recordings()[0])
    assert frame.camera == CAMERA
    assert frame.up_camera == pytest.approx([0.0, -0.8, 0.6])
    assert Rig().turn(frame) == rig.turn(bare.frame)


def test_what_the_source_knows_of_its_depth_comes_back(record, recordings, read, result) -> None:
    noise = DepthNoise(noise_per_m=0.004, noise_m=0.01, correlation_px=8.0)
    recorder = record(waits=True)
    for number, known in enumerate((noise, None)):
        one = result(number, depth_m=MILLIMETRES, camera=CAMERA)
        frame = dataclasses.replace(one.frame, depth_noise=known)
        recorder.write(dataclasses.replace(one, frame=frame))
    recorder.mark()
    recorder.close()
    assert [frame.depth_noise for frame in read(recordings()[0])] == [noise, None]


def test_the_depth_of_beams_comes_back_with_and_without_its_gaps(
    record, recordings, read, result
) -> None:
    """The model sees the one, the measurement the other; a frame without beams stays as it is."""
    recorder = record(waits=True)
    beams = np.where(np.arange(HEIGHT)[:, None] % 4, np.float32(0), FLOATS)
    filled = [FLOATS, FLOATS * np.float32(1.1), None]
    for number, filled_m in enumerate(filled):
        one = result(number, image=IMAGE, depth_m=beams, camera=CAMERA)
        frame = dataclasses.replace(one.frame, filled_depth_m=filled_m)
        recorder.write(dataclasses.replace(one, frame=frame))
    recorder.mark()
    recorder.close()
    found = read(recordings()[0])
    assert [frame.depth_m.tobytes() for frame in found] == [beams.tobytes()] * 3
    for frame, wanted in zip(found, filled, strict=True):
        assert (frame.filled_depth_m is None) == (wanted is None)
        if wanted is not None:
            assert frame.filled_depth_m.tobytes() == wanted.tobytes()


def measured(result: LiveResult) -> list[dict[str, Any]]:
    """The trees of a frame with their metres."""
    trees = live_record(result)["trees"]
    return [{key: tree[key] for key in ("score", "box_px", "metres")} for tree in trees]


def test_trees_and_metres_of_the_sample_frames_are_the_same(
    record, recordings, said, sample_results
) -> None:
    detector = TreeDetector.load(default_model("depth"))
    recorder = record(waits=True)
    frames = [one.frame for one in sample_results]
    results = list(LivePipeline(lambda: _Given(frames), detector))
    for one in results:
        recorder.write(one)
    recorder.mark("wrong")
    recorder.close()
    (folder,) = recordings()
    again = list(LivePipeline(lambda: open_live_source(str(folder)), detector))
    assert len(again) == len(results) > 1
    assert sum(len(one.trees) for one in results) > 3
    for first, second in zip(results, again, strict=True):
        assert second.trees.boxes_px.tobytes() == first.trees.boxes_px.tobytes()
        assert measured(second) == measured(first)
    stored = said(folder, "/edgetree/json")
    assert [one["trees"] for one in stored] == [live_record(one)["trees"] for one in results]


class _Given:
    """A source of given frames."""

    name, is_live = "given", False

    def __init__(self, frames: list[Any]) -> None:
        self.counts: dict[str, int] = {}
        self._frames = frames

    def __iter__(self) -> Any:
        return iter(self._frames)

    def close(self) -> None:
        pass
