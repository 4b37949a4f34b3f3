"""Captures of phones: what their files say, what is measured in them, and what is refused."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import phone_captures
import pytest
from phone_captures import LANDSCAPE, PORTRAIT, RADIUS_M, record3d_files, write_stray, zipped

import calib
from basetree.errors import InputError
from edgetree.detections import TreeDetections
from edgetree.frames import Frame, Rig
from edgetree.frames.pipeline import FoundTrees, measure_frame
from edgetree.sources import open_capture, open_frames, open_live_source
from edgetree.sources.phones.lzfse import unpack, unpacked_bytes

Cli = Callable[..., Any]


@pytest.fixture
def write_r3d(tmp_path: Path) -> Callable[..., Path]:
    pytest.importorskip("lzfse")

    def write(**options: Any) -> Path:
        path = tmp_path / "walk.r3d"
        path.write_bytes(zipped(record3d_files(**options)))
        return path

    return write


def up(number: int, quarter_turns: int = 0) -> np.ndarray:
    return phone_captures.mounting(number, quarter_turns).rotation[2]


def measured(frame: Frame, quarter_turns: int = 0) -> Any:
    """The stem of a frame, in its true outline."""
    assert frame.camera is not None
    assert frame.number is not None
    pose = phone_captures.mounting(frame.number, quarter_turns)
    mask = phone_captures.cast(frame.camera, pose)[1]
    rows, columns = np.nonzero(mask)
    box = np.array([[columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]], np.float32)
    size = (frame.camera.width, frame.camera.height)
    trees = TreeDetections(box, np.ones(1, np.float32), None, None, *size)
    result = measure_frame(frame, FoundTrees(trees, (1,), mask[None]), Rig())
    assert result.measurements is not None
    return result.measurements[0]


def assert_right(stem: Any) -> None:
    for estimate, value in ((stem.dbh_m, 2 * RADIUS_M), (stem.axis_distance_m, 2.5)):
        assert estimate, estimate
        assert abs(estimate.value - value) < min(3 * estimate.std, 0.05 * value)
    assert stem.inclination_deg.value < 3


def test_record3d_gives_colour_depth_camera_time_pose_and_gravity(write_r3d: Any) -> None:
    source = open_capture(write_r3d())
    frames = list(source)
    assert source.count == len(frames) == 3
    for number, frame in enumerate(frames):
        assert frame.name == f"walk_{number:06d}"
        assert frame.time_s == pytest.approx(0.5 + number / 30)
        assert frame.image.shape == (960, 720, 3)
        assert frame.camera == PORTRAIT
        np.testing.assert_allclose(frame.up_camera, up(number), atol=1e-6)
        exact = phone_captures.cast(PORTRAIT, phone_captures.mounting(number))[0]
        off = np.abs(frame.depth_m - exact)[exact > 0]
        assert np.median(off) < 0.01
    moved = frames[2].pose.translation_m - frames[0].pose.translation_m
    assert np.linalg.norm(moved) == pytest.approx(0.02, abs=1e-6)
    assert moved[2] == pytest.approx(0, abs=1e-6)


def test_a_stem_in_a_capture_of_record3d_is_measured(write_r3d: Any) -> None:
    for frame in open_capture(write_r3d(frames=2)):
        assert_right(measured(frame))


@pytest.mark.parametrize("quarter_turns", [0, 1, 3])
def test_a_stem_in_a_capture_of_stray_scanner_is_measured(
    tmp_path: Path, quarter_turns: int
) -> None:
    folder = write_stray(tmp_path / "71de12f9", quarter_turns=quarter_turns, frames=2)
    frames = list(open_capture(folder))
    assert len(frames) == 2
    for number, frame in enumerate(frames):
        assert frame.time_s == pytest.approx(100 + number / 30)
        assert frame.image.shape == (540, 720, 3)
        np.testing.assert_allclose(frame.up_camera, up(number, quarter_turns), atol=1e-6)
        assert frame.camera.fx == pytest.approx(LANDSCAPE.fx / 2)
        assert Rig().turn(frame).quarters == quarter_turns
        assert_right(measured(frame, quarter_turns))


def test_older_odometry_without_a_header_is_read(tmp_path: Path) -> None:
    folder = write_stray(tmp_path / "a", header=False, frames=2)
    frames = list(open_capture(folder))
    np.testing.assert_allclose(frames[1].up_camera, up(1), atol=1e-6)
    assert frames[1].time_s == pytest.approx(1 / 30, abs=1e-3)


def test_odometry_with_an_open_quote_is_refused_in_one_line(tmp_path: Path) -> None:
    folder = write_stray(tmp_path / "a", frames=2)
    (folder / "odometry.csv").write_text('"' + "1" * 140_000)
    with pytest.raises(InputError, match=r"odometry\.csv cannot be read \(field larger"):
        open_capture(folder)


def test_poses_that_begin_at_the_first_camera_take_the_start(write_r3d: Any) -> None:
    for number, frame in enumerate(open_capture(write_r3d(poses="relative"))):
        np.testing.assert_allclose(frame.up_camera, up(number), atol=1e-4)


@pytest.mark.parametrize(("poses", "has_pose"), [("unknown", True), ("none", False)])
def test_a_vertical_that_is_not_stored_is_not_guessed(
    write_r3d: Any, poses: str, has_pose: bool
) -> None:
    source = open_capture(write_r3d(poses=poses))
    frame, *_ = source
    assert frame.up_camera is None
    assert (frame.pose is not None) == has_pose
    assert source.counts["without gravity"] == 3
    assert measured(frame).dbh_m


def test_poses_of_a_capture_whose_beginning_was_cut_have_no_vertical(write_r3d: Any) -> None:
    path = write_r3d(poses="relative", frames=1)
    files = record3d_files(poses="relative", frames=1)
    values = json.loads(files["metadata"])
    turned = phone_captures.quaternion(cv2.Rodrigues(np.array([0.0, 0.4, 0.1]))[0])
    values["poses"] = [[*turned, 0.0, 0.0, 0.0]]
    path.write_bytes(zipped(files | {"metadata": json.dumps(values).encode()}))
    (frame,) = open_capture(path)
    assert frame.up_camera is None
    assert frame.pose is not None


def test_the_unpacked_folder_is_read_too(tmp_path: Path) -> None:
    pytest.importorskip("lzfse")
    for name, content in record3d_files(frames=1).items():
        (tmp_path / "walk" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "walk" / name).write_bytes(content)
    assert len(list(open_frames(tmp_path / "walk"))) == 1


def test_older_metadata_state_no_size_of_the_depth(write_r3d: Any) -> None:
    changed = {"frameTimestamps": None, "perFrameIntrinsicCoeffs": None, "dw": None, "dh": None}
    frame, second, _ = open_capture(write_r3d(**changed))
    assert frame.depth_m.shape == (960, 720)
    assert second.time_s == pytest.approx(1 / 30)


def test_low_confidence_is_no_reading(tmp_path: Path) -> None:
    folder = write_stray(tmp_path / "a", frames=1)
    confidence = np.full((192, 256), 2, np.uint8)
    confidence[:, :128] = 0
    cv2.imwrite(str(folder / "confidence" / "000000.png"), confidence)
    (frame,) = open_capture(folder)
    assert not frame.depth_m[:, :360].any()
    assert frame.depth_m[450, 370:].all()


def test_a_rig_takes_the_place_of_the_camera(write_r3d: Any) -> None:
    camera = calib.PinholeCamera(720, 960, 650.0, 650.0, 359.5, 479.5)
    (frame,) = open_capture(write_r3d(frames=1), rig=Rig(camera))
    assert frame.camera == camera


def test_a_frame_that_cannot_be_read_is_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("lzfse")
    files = record3d_files()
    files["rgbd/1.jpg"] = b"no picture"
    del files["rgbd/2.depth"]
    path = tmp_path / "walk.r3d"
    path.write_bytes(zipped(files))
    source = open_capture(path)
    with caplog.at_level(logging.WARNING):
        assert [frame.number for frame in source] == [0]
    assert source.counts["unreadable images"] == 2
    assert "rgbd/1.jpg" in caplog.text
    assert "rgbd/2.depth of" in caplog.text


BROKEN_METADATA = {
    "no JSON": (b"{", "is not JSON"),
    "no size": (b'{"K": [1]}', "no field 'w'"),
    "four numbers of K": (b'{"w": 4, "h": 4, "K": [1, 2, 3, 4]}', "K has 4 numbers, expected 9"),
    "a pose of six": (
        b'{"w": 4, "h": 4, "K": [1,0,0,0,1,0,2,2,1], "poses": [[0, 0, 0, 1, 0, 0]]}',
        "a pose has 6 numbers",
    ),
    "no rotation": (
        b'{"w": 4, "h": 4, "K": [1,0,0,0,1,0,2,2,1], "poses": [[9, 0, 0, 1, 0, 0, 0]]}',
        "expected length 1",
    ),
    "no camera": (b'{"w": 4, "h": 4, "K": [0,0,0,0,0,0,0,0,0]}', "fx is"),
}


@pytest.mark.parametrize("name", BROKEN_METADATA)
def test_broken_metadata_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    content, words = BROKEN_METADATA[name]
    path = tmp_path / "a.r3d"
    path.write_bytes(zipped({"metadata": content, "rgbd/0.jpg": b""}))
    with pytest.raises(InputError, match=words):
        list(open_capture(path))


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "no whole zip"), (b"PK\x03\x04 cut", "no whole zip"), (zipped({}), "has 0 frames")],
)
def test_what_is_no_capture_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "a.r3d"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words):
        open_capture(path)


def test_depth_as_exr_names_what_to_export(tmp_path: Path) -> None:
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth" / "0.exr").write_bytes(b"")
    (tmp_path / "metadata.json").write_text("{}")
    with pytest.raises(InputError, match=r"depth as EXR, .*expected the capture as \.r3d"):
        open_frames(tmp_path)


@pytest.mark.parametrize("size", [10, 100_000, 4_000_000])
def test_what_lzfse_states_is_what_it_unpacks_to(size: int) -> None:
    lzfse = pytest.importorskip("lzfse")
    noise = np.random.default_rng(1000).integers(0, 20, size).astype(np.uint8).tobytes()
    data = lzfse.compress(noise)
    assert unpacked_bytes(data) == size
    assert unpack(data, size) == noise
    with pytest.raises(InputError, match="unpacks to"):
        unpack(data, size + 1)
    with pytest.raises(InputError, match=r"cut off|a block|damaged"):
        unpack(data[:-4], size)


def test_run_and_live_take_captures(
    run_cli: Cli, write_r3d: Any, model: Path, tmp_path: Path
) -> None:
    done = run_cli("run", write_r3d(), "--model", model, "--map", tmp_path / "stems.geojson")
    assert done.code == 0, done.err
    lines = [json.loads(line) for line in done.out.splitlines()]
    assert [line["frame"] for line in lines] == [f"walk_{number:06d}" for number in range(3)]
    assert all("diameter_failure" in tree["metres"] or tree["metres"] for tree in lines[0]["trees"])
    done = run_cli("live", write_r3d(), "--model", model)
    assert done.code == 0, done.err
    folder = write_stray(tmp_path / "stray", frames=1)
    assert len(list(open_live_source(str(folder)))) == 1
    done = run_cli("measure", folder, "--camera", "camera.json")
    assert done.code == 2
    assert "use `edgetree run`" in done.err


def test_depth_and_pose_stay_in_step_behind_a_lost_picture(tmp_path: Path) -> None:
    """A video whose fourth picture is damaged, of a capture of six."""
    small = calib.PinholeCamera(320, 240, 230.0, 230.0, 159.5, 119.5)
    folder = write_stray(tmp_path / "a", small, frames=6)
    path = folder / "rgb.mp4"
    data = bytearray(path.read_bytes())
    starts = [at for at in range(len(data)) if data.startswith(b"\0\0\1\xb6", at)]
    data[starts[3] : starts[4]] = bytes(starts[4] - starts[3])
    path.write_bytes(data)
    source = open_capture(folder)
    frames = list(source)
    assert [int(frame.name[-6:]) for frame in frames] == [0, 1, 2, 4, 5]
    for frame in frames:
        assert frame.pose is not None
        assert frame.time_s == pytest.approx(100 + int(frame.name[-6:]) / 30)
        expected = phone_captures.mounting(int(frame.name[-6:])).translation_m
        np.testing.assert_allclose(frame.pose.translation_m, expected, atol=1e-6)
    assert source.counts["broken video frames"] == 1
