"""Tests of `edgetree calibrate`: output, files and errors."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import fake_boards as fake
import numpy as np
import pytest
from schema_check import check_schema

import calib

BOARD = "charuco:8x6:0.03:0.022:4x4_50"
SCALE, OFFSET_M = 1.02, 0.015


Cli = Callable[..., Any]


@pytest.fixture
def calibrate(run_cli: Cli) -> Cli:
    """Run `edgetree calibrate` with these arguments."""
    return partial(run_cli, "calibrate")


@pytest.fixture(scope="module")
def board_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder `pictures` with 14 pictures of the board and one without, and their `depth`."""
    folder = tmp_path_factory.mktemp("board")
    for name in ("pictures", "depth"):
        (folder / name).mkdir()
    poses = fake.poses(fake.RADTAN, 14, seed=2)
    for i, (pose, grey) in enumerate(
        zip(poses, fake.rendered(fake.RADTAN, fake.BOARDS["charuco"], poses), strict=True)
    ):
        cv2.imwrite(str(folder / "pictures" / f"p{i:02}.png"), grey)
        rows, columns = np.mgrid[0:480, 0:640]
        rays = calib.pixels_to_rays(fake.RADTAN, np.stack([columns, rows], -1) + 0.5)
        normal = pose.rotation[:, 2]
        true_m = (normal @ pose.translation_m) / (rays @ normal)
        calib.write_depth(folder / "depth" / f"p{i:02}.png", (true_m - OFFSET_M) / SCALE)
    cv2.imwrite(str(folder / "pictures" / "sky.png"), np.full((480, 640), 200, np.uint8))
    calib.write_depth(folder / "depth" / "sky.png", np.zeros((480, 640), np.float32))
    return folder


def test_a_folder_of_pictures_gives_a_camera_file(
    calibrate: Cli, board_files: Path, tmp_path: Path
) -> None:
    out = tmp_path / "new folder" / "left camera.json"
    done = calibrate(board_files / "pictures", "--board", BOARD, "--out", out)
    assert done.code == 0, done.err
    camera = calib.load_camera(out)
    assert camera.fx == pytest.approx(fake.RADTAN.fx, abs=1.5)
    assert camera.cx == pytest.approx(fake.RADTAN.cx, abs=1.5)
    assert 0 < camera.focal_std_px < 2
    assert list(out.parent.iterdir()) == [out]

    lines = done.out.splitlines()
    assert lines[0] == "14 of 15 pictures show the board in a new position, 640x480 px"
    assert lines[1] == "no board found in sky"
    assert re.fullmatch(r"p03 +\d+ +0\.\d\d +\d\.\d\d +0\.\d\d +\d+", lines[6])
    fx = next(line for line in lines if line.startswith("fx"))
    value, std = map(float, re.findall(r"[\d.]+", fx))
    assert value == pytest.approx(camera.fx, abs=0.01)
    assert std == pytest.approx(camera.focal_std_px, rel=0.1)
    assert fx.endswith(" px")
    grid = [line.strip() for line in lines if re.fullmatch(r"  [.1-9]{12}", line)]
    assert len(grid) == 9
    assert max(map(len, lines)) <= 100
    assert f"written: {out}" in done.err
    assert f"next: edgetree measure IMAGE --depth DEPTH --camera '{out}'" in done.err


def test_depth_images_give_scale_and_offset(
    calibrate: Cli, board_files: Path, tmp_path: Path
) -> None:
    out = tmp_path / "camera.json"
    pictures, depth = board_files / "pictures", board_files / "depth"
    done = calibrate(pictures, "--board", BOARD, "--depth", depth, "--out", out, "--json")
    assert done.code == 0, done.err
    record = json.loads(done.out)
    assert (check_schema(record), record["passed"]) == ("edgetree.calibrate/1", True)
    assert (record["pictures"], record["without_board"]) == (15, ["sky"])
    assert record["camera_file"] == str(out)
    assert {"fx", "cy", "k3"} <= {parameter["name"] for parameter in record["parameters"]}
    scale = calib.load_depth_scale(record["depth_scale_file"])
    assert record["depth_scale_file"] == str(tmp_path / "camera.depth_scale.json")
    assert record["depth_scale"]["scale"] == scale.scale
    for true_m in (0.3, 0.6):
        read_m = np.array([(true_m - OFFSET_M) / SCALE])
        assert scale.apply(read_m)[0] == pytest.approx(true_m, rel=0.004)

    table = calibrate(pictures, "--board", BOARD, "--depth", depth, "--out", out)
    assert table.err.endswith(f"--camera {out} --depth-scale {record['depth_scale_file']}\n")
    assert re.search(r"^depth: true = \(1\.0\d+ ± 0\.\d+\) x reading", table.out, re.MULTILINE)


def test_a_square_typed_wrong_gives_no_depth_scale(
    calibrate: Cli, board_files: Path, tmp_path: Path
) -> None:
    out = tmp_path / "camera.json"
    typed = "charuco:8x6:0.036:0.0264:4x4_50"
    options = ("--board", typed, "--depth", board_files / "depth", "--out", out)
    done = calibrate(board_files / "pictures", *options)
    assert done.code == 1
    assert "no depth scale: the depth would have a scale of 1.2" in done.err
    assert re.search(r"sides of 29\.\d+ mm instead of the 36 mm given", done.err)
    assert "next:" not in done.err
    assert not (tmp_path / "camera.depth_scale.json").exists()


def test_a_broken_picture_is_named_and_the_camera_is_written(
    calibrate: Cli, board_files: Path, tmp_path: Path
) -> None:
    shutil.copytree(board_files / "pictures", tmp_path / "pictures")
    shutil.copytree(board_files / "depth", tmp_path / "depth")
    broken = tmp_path / "pictures" / "p05.png"
    broken.write_text("no picture")
    out = tmp_path / "camera.json"
    options = ("--board", BOARD, "--out", out, "--depth", tmp_path / "depth")
    done = calibrate(tmp_path / "pictures", *options, "--json")
    assert done.code == 1
    assert calib.load_camera(out).width == 640
    lines = done.err.splitlines()
    assert lines[0].startswith(f"left out: image {broken} cannot be read")
    assert lines[-1] == "edgetree: 1 of 15 frames left out, see above"
    record = json.loads(done.out)
    assert record["pictures"] == 14
    assert record["left_out"] == [lines[0].removeprefix("left out: ")]


def test_depth_images_in_place_of_pictures_are_named(calibrate: Cli, board_files: Path) -> None:
    done = calibrate(board_files / "depth", "--board", BOARD)
    assert done.code == 2
    assert "p05.png is a depth image: expected a picture of 8 bits" in done.err
    assert done.err.splitlines()[-1].startswith("edgetree: all 15 frames left out")


def test_a_video_is_a_source(calibrate: Cli, board_files: Path, tmp_path: Path) -> None:
    video = tmp_path / "board.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 2.0, (640, 480))
    for path in sorted((board_files / "pictures").glob("p*.png")):
        writer.write(cv2.imread(str(path)))
    writer.release()
    done = calibrate(video, "--board", BOARD, "--out", tmp_path / "camera.json", "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["views"][0]["name"] == "board_000000"


def test_too_few_views_fail_and_write_nothing(
    calibrate: Cli, board_files: Path, tmp_path: Path
) -> None:
    few = tmp_path / "few"
    few.mkdir()
    for path in sorted((board_files / "pictures").glob("p0[0-2].png")):
        shutil.copy(path, few)
    out = tmp_path / "new" / "camera.json"
    done = calibrate(few, "--board", BOARD, "--out", out)
    assert done.code == 1
    assert done.err == "edgetree: 3 views of the board, expected at least 8\n"
    assert "advice: take 15 to 30 images" in done.out
    assert not out.parent.exists()
    record = json.loads(calibrate(few, "--board", BOARD, "--out", out, "--json").out)
    assert (record["passed"], record["camera_file"]) == (False, None)
    other = calibrate(few, "--board", "checkerboard:9x6:0.025", "--out", out)
    assert other.code == 1
    assert "no board found: give the number of inner corners" in other.out


def test_an_inaccurate_camera_is_not_written(
    calibrate: Cli, board_files: Path, tmp_path: Path
) -> None:
    narrow = tmp_path / "narrow"
    narrow.mkdir()
    for path in sorted((board_files / "pictures").glob("p*.png")):
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        grey[:, 360:] = 120
        cv2.imwrite(str(narrow / path.name), grey)
    out = tmp_path / "camera.json"
    done = calibrate(narrow, "--board", BOARD, "--out", out)
    assert done.code == 1
    assert "of the image, expected at least 50%" in done.err
    assert "advice: the right edge has no points: hold the board there" in done.out
    assert not out.exists()


def test_depth_at_one_distance_fails_but_the_camera_is_written(
    calibrate: Cli, board_files: Path, tmp_path: Path
) -> None:
    flat = tmp_path / "flat"
    flat.mkdir()
    for path in (board_files / "depth").iterdir():
        calib.write_depth(flat / path.name, np.full((480, 640), 0.5, np.float32))
    out = tmp_path / "camera.json"
    done = calibrate(board_files / "pictures", "--board", BOARD, "--depth", flat, "--out", out)
    assert done.code == 1
    written, why = done.err.splitlines()
    assert written == f"written: {out}"
    assert why.startswith("edgetree: no depth scale: the readings went from 0.50 to 0.50 m")
    assert out.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["camera.json", "flat"]


BAD_INPUTS = {
    "a board of no kind": ("pictures --board chess:9x6:0.025", "expected one such as checkerboard"),
    "a board in millimetres": ("pictures --board checkerboard:9x6:25", "square_m is 25: expected"),
    "another lens": (f"pictures --board {BOARD} --model brown", "expected radtan or fisheye"),
    "no board": ("pictures", r"--board.*see `edgetree calibrate --help`"),
    "no source": (f"none --board {BOARD}", "source none does not exist"),
    "no pictures": (f"empty --board {BOARD}", "folder empty has no images"),
    "two sizes": (f"mixed --board {BOARD}", "small is 320x240 px: expected 640x480 px, as p00"),
    "no depth": (f"pictures --board {BOARD} --depth none", "depth none is not a folder"),
    "depth missing": (
        f"pictures --board {BOARD} --depth empty",
        "does not exist.*expected one for",
    ),
    "a picture to write": (f"mixed --board {BOARD} --out mixed/p00.png", "--out is mixed/p00.png:"),
    "a folder to write": (f"mixed --board {BOARD} --out empty", "empty is a folder"),
}


@pytest.mark.parametrize("case", BAD_INPUTS)
def test_bad_input_gives_one_line_and_no_files(
    calibrate: Cli,
    board_files: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    case: str,
) -> None:
    for name in ("pictures", "empty", "mixed"):
        (tmp_path / name).mkdir()
    first = board_files / "pictures" / "p00.png"
    shutil.copy(first, tmp_path / "pictures")
    shutil.copy(first, tmp_path / "mixed")
    cv2.imwrite(str(tmp_path / "mixed" / "small.png"), np.zeros((240, 320), np.uint8))
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))

    arguments, message = BAD_INPUTS[case]
    done = calibrate(*arguments.split())

    assert done.code == 2
    assert done.out == ""
    assert done.err.count("\n") == 1, done.err
    assert done.err.startswith("edgetree: ")
    assert re.search(message, done.err), done.err
    assert sorted(tmp_path.rglob("*")) == before
