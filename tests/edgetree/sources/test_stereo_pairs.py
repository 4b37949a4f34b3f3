"""Stereo pairs as sources: pictures, folders, the commands, and what is measured."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import phone_captures
import pytest
from phone_captures import DISTANCE_M, RADIUS_M
from textured_pair import bent_pair, pictures

import calib
from basetree.errors import InputError
from calib.files.stereo import save_stereo
from edgetree.detections import TreeDetections
from edgetree.frames import Frame, Rig
from edgetree.frames.pipeline import FoundTrees, measure_frame
from edgetree.sources import stereo
from edgetree.sources.source import readable
from edgetree.sources.stereo import open_stereo, stereo_rig

Cli = Callable[..., Any]


@pytest.fixture
def pair_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to a folder with `left`, `right` and `pair.json`."""
    monkeypatch.chdir(tmp_path)
    pair = bent_pair()
    for side, image in zip(("left", "right"), pictures(pair), strict=True):
        (tmp_path / side).mkdir()
        for number in range(2):
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), image)
    save_stereo(tmp_path / "pair.json", pair)
    return tmp_path


def rectified_mask() -> np.ndarray:
    rectified = bent_pair().rectified
    turn = calib.RigidTransform(rectified.rotation, np.zeros(3)).inverse()
    return phone_captures.cast(rectified.camera, turn.then(phone_captures.mounting(0)))[1]


def test_a_stem_in_a_pair_is_measured(pair_folder: Path) -> None:
    pair = bent_pair()
    up = phone_captures.mounting(0).rotation[2]
    rig = stereo_rig(Rig(up_camera=tuple(up)), pair)
    frames = list(open_stereo(pair_folder / "left", pair_folder / "right", pair, rig=rig))
    assert [frame.name for frame in frames] == ["0", "1"]
    frame = frames[0]
    assert frame.camera == pair.rectified.camera
    mask = rectified_mask()
    rows, columns = np.nonzero(mask)
    box = np.array([[columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]], np.float32)
    size = (frame.camera.width, frame.camera.height)
    trees = TreeDetections(box, np.ones(1, np.float32), None, None, *size)
    result = measure_frame(frame, FoundTrees(trees, (1,), mask[None]), rig)
    assert result.measurements is not None
    (stem,) = result.measurements
    for estimate, value in ((stem.dbh_m, 2 * RADIUS_M), (stem.axis_distance_m, DISTANCE_M)):
        assert estimate, estimate
        assert abs(estimate.value - value) < min(3 * estimate.std, 0.04 * value)
    assert stem.inclination_deg.value < 3  # by the vertical of the rectified camera


def test_the_mounting_is_turned_with_the_pictures() -> None:
    pair, mounting = bent_pair(), phone_captures.mounting(0)
    rig = stereo_rig(Rig(mounting=mounting, up_camera=tuple(mounting.rotation[2])), pair)
    assert rig.mounting is not None
    ahead = pair.rectified.rotation @ np.array([0.1, 0.2, 4.0])
    np.testing.assert_allclose(rig.mounting.apply(ahead), mounting.apply([0.1, 0.2, 4.0]))
    np.testing.assert_allclose(rig.mounting.rotation[2], rig.up_camera)


def test_live_takes_pairs(run_cli: Cli, pair_folder: Path) -> None:
    given = ("--right", "right", "--camera", "pair.json", "--jsonl", "trees.jsonl")
    done = run_cli("live", "left", *given)
    assert done.code == 0, done.err
    lines = [json.loads(line) for line in Path("trees.jsonl").read_text().splitlines()]
    assert [line["frame"] for line in lines] == [0, 1]
    assert "for depth images" in done.err


def test_run_and_measure_take_pairs(run_cli: Cli, pair_folder: Path) -> None:
    given = ("--right", "right", "--camera", "pair.json", "--csv", "trees.csv")
    done = run_cli("run", "left", *given)
    assert done.code == 0, done.err
    assert len(done.out.splitlines()) == 2
    assert "for depth images" in done.err
    assert "--right right" in done.err.splitlines()[-1]
    cv2.imwrite("mask.png", rectified_mask().astype(np.uint8))
    up = ",".join(map(str, phone_captures.mounting(0).rotation[2]))
    given = ("left/0.png", "--right", "right/0.png", "--camera", "pair.json", "--mask", "mask.png")
    done = run_cli("measure", *given, "--json", "--up", up)
    assert done.code == 0, done.err
    (tree,) = json.loads(done.out)["frame"]["trees"]
    assert tree["metres"].get("dbh_m") == pytest.approx(0.3, abs=0.02), tree["metres"]


WRONG = {
    "no calibration": ("run left --right right", "--right given without --camera"),
    "depth as well": (
        "run left --right right --camera pair.json --depth left",
        "--right given with --depth",
    ),
    "one camera": ("run left --right right --camera one.json", "no known format of a stereo pair"),
    "fewer pictures": ("run left --right fewer --camera pair.json", "has 2 pictures and fewer has"),
    "no right picture": (
        "measure left/0.png --right nothing.png --camera pair.json",
        "nothing.png does not exist",
    ),
    "a kind of depth": (
        "run left --right right --camera pair.json --depth-kind range",
        "given with --right: expected none",
    ),
    "live, no calibration": ("live left --right right", "--right given without --camera"),
    "live, depth as well": (
        "live left --right right --camera pair.json --depth left",
        "--right given with --depth",
    ),
    "live, a way without depth": (
        "live left --right right --camera pair.json --camera-height 2.5",
        "--right given with an option for pictures without depth",
    ),
    "live, a camera": (
        "live 0 --right right --camera pair.json",
        "right is given for source 0: expected it for pictures and videos alone",
    ),
    "live, programs": (
        "live clients --serve ipc:///tmp/f --right right --camera pair.json",
        "right is given for source clients: expected it for pictures and videos alone",
    ),
    "live, fewer pictures": (
        "live left --right fewer --camera pair.json",
        "has 2 pictures and fewer has",
    ),
    "parts": (
        "run left --right right --camera pair.json --shards parts",
        "--right given with --shards",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_options_that_do_not_fit_give_one_line(run_cli: Cli, pair_folder: Path, name: str) -> None:
    calib.save_camera(pair_folder / "one.json", bent_pair().left)
    (pair_folder / "fewer").mkdir()
    (pair_folder / "fewer" / "0.png").write_bytes((pair_folder / "right" / "0.png").read_bytes())
    command, words = WRONG[name]
    done = run_cli(*command.split())
    assert done.code == 2
    assert words in done.err
    assert len(done.err.splitlines()) == 1


def test_pictures_that_do_not_match_are_a_fault(pair_folder: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (420, 560, 3)).astype(np.uint8)
    cv2.imwrite(str(pair_folder / "right" / "1.png"), noise)
    first, second = open_stereo(pair_folder / "left", pair_folder / "right", bent_pair())
    assert first.depth_fault is None
    assert second.depth_fault is not None
    assert "left and right picture match nowhere: expected two pictures" in second.depth_fault


def test_pictures_that_hardly_match_are_told(
    pair_folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    right, left = pair_folder / "right", pair_folder / "left"
    swapped = list(open_stereo(right, left, bent_pair(), rig=Rig()))
    assert [frame.depth_fault for frame in swapped] == [None, None]
    assert caplog.text.count("right: left and right pictures match at less than 3 %") == 1
    assert "left and right in their order" in caplog.text


def test_pictures_of_16_bits_are_named(pair_folder: Path) -> None:
    for side in ("left", "right"):
        for path in (pair_folder / side).glob("*.png"):
            grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            cv2.imwrite(str(path), grey.astype(np.uint16) * 256)
    with pytest.raises(InputError, match=r"png is a depth image: expected a picture of 8 bits"):
        list(open_stereo(pair_folder / "left", pair_folder / "right", bent_pair()))


def test_pairs_stay_in_step_behind_a_left_picture_that_cannot_be_read(pair_folder: Path) -> None:
    for side in ("left", "right"):
        (pair_folder / side / "2.png").write_bytes((pair_folder / side / "1.png").read_bytes())
    (pair_folder / "left" / "1.png").write_bytes(b"broken")
    small = np.zeros((210, 280, 3), np.uint8)  # which would be told if it were taken
    cv2.imwrite(str(pair_folder / "right" / "1.png"), small)
    told: list[Exception] = []
    source = open_stereo(pair_folder / "left", pair_folder / "right", bent_pair())
    assert [frame.name for frame in readable(source, told.append)] == ["0", "2"]
    assert ["left/1.png" in str(error) for error in told] == [True]


def test_pictures_of_another_size_are_left_out(pair_folder: Path) -> None:
    small = np.zeros((210, 280, 3), np.uint8)
    cv2.imwrite(str(pair_folder / "right" / "1.png"), small)
    frames = iter(open_stereo(pair_folder / "left", pair_folder / "right", bent_pair()))
    next(frames)
    with pytest.raises(InputError, match=r"1\.png is 280x210 px: expected 560x420 px, like"):
        next(frames)


def test_folders_that_lack_different_pictures_are_refused(pair_folder: Path) -> None:
    """By their order, every picture from the first missing one on would be of another moment."""
    for side in ("left", "right"):
        for number in range(2, 5):
            (pair_folder / side / f"{number}.png").write_bytes(b"content")
    (pair_folder / "left" / "2.png").unlink()
    (pair_folder / "right" / "3.png").unlink()
    with pytest.raises(InputError, match="3 of the left beside 2 of the right: expected the same"):
        open_stereo(pair_folder / "left", pair_folder / "right", bent_pair())


@pytest.fixture
def videos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to a folder with left.avi and right.avi, of ten frames that get lighter."""
    monkeypatch.chdir(tmp_path)
    for side in ("left", "right"):
        writer = cv2.VideoWriter(f"{side}.avi", cv2.VideoWriter.fourcc(*"MJPG"), 10, (560, 420))
        for number in range(10):
            writer.write(np.full((420, 560, 3), 20 * number, np.uint8))
        writer.release()
    return tmp_path


@pytest.mark.parametrize("side", ["left", "right"])
def test_videos_stay_in_step_behind_a_frame_that_cannot_be_decoded(
    videos: Path, monkeypatch: pytest.MonkeyPatch, side: str
) -> None:
    path = videos / f"{side}.avi"
    data = bytearray(path.read_bytes())
    starts = [at for at in range(len(data)) if data.startswith(b"00dc", at)]
    data[starts[4] + 8 : starts[5]] = bytes(starts[5] - starts[4] - 8)
    path.write_bytes(data)
    seen: list[tuple[int, int]] = []

    def noted(left: Frame, right: np.ndarray, *_: object) -> Frame:
        seen.append((round(left.picture().mean() / 20), round(right.mean() / 20)))
        return left

    monkeypatch.setattr(stereo, "stereo_frame", noted)
    source = open_stereo("left.avi", "right.avi", bent_pair())
    assert len(list(source)) == 9
    assert seen == [(number, number) for number in range(10) if number != 3]
    other = "right" if side == "left" else "left"
    assert source.counts[f"{other} pictures without a {side} one"] == 1
    assert source.counts["broken video frames"] == 1


def test_a_video_that_is_cut_off_makes_no_whole_pair(run_cli: Cli, videos: Path) -> None:
    save_stereo("pair.json", bent_pair())
    data = (videos / "right.avi").read_bytes()
    (videos / "right.avi").write_bytes(data[: len(data) // 2])
    done = run_cli("run", "left.avi", "--right", "right.avi", "--camera", "pair.json")
    assert done.code == 1
    assert "1 ended early" in done.err
    assert "is not complete, see above" in done.err
