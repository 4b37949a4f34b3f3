"""Tests of `edgetree run` with depth and cameras: table, unusable depth and messages."""

from __future__ import annotations

import csv
import json
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib

Cli = Callable[..., Any]


@pytest.fixture
def folder(images: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to the folder with `images`, `depth` and `camera.json`."""
    monkeypatch.chdir(images.parent)
    return images.parent


FRAMES = ("run", "images", "--depth", "depth", "--camera", "camera.json")


def _rows(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.open(newline="", encoding="utf-8")))


def test_the_table_has_all_trees_of_all_frames(run_cli: Cli, model: Path, folder: Path) -> None:
    done = run_cli(*FRAMES, "--model", model, "--csv", "trees.csv")
    assert done.code == 0, done.err
    rows = _rows(folder / "trees.csv")
    lines = [json.loads(line) for line in done.out.splitlines()]
    assert [row["frame"] for row in rows] == ["a", "b"]
    metres = lines[0]["trees"][0]["metres"]
    assert float(rows[0]["diameter_m"]) == pytest.approx(metres["diameter_m"], abs=1e-4)
    assert rows[0]["tree"] == "1"
    assert lines[0]["trees"][0]["tree"] == 1
    assert "table: trees.csv" in done.err


def test_depth_that_is_found_in_the_folder_chooses_the_model(run_cli: Cli, folder: Path) -> None:
    (folder / "drive").mkdir()
    (folder / "images").rename(folder / "drive" / "rgb")
    (folder / "depth").rename(folder / "drive" / "depth")
    done = run_cli("run", "drive", "--camera", "camera.json")
    assert done.code == 0, done.err
    assert "images of drive/rgb with the depth of drive/depth" in done.err
    assert "for depth images" in done.err


@pytest.mark.parametrize("given", ["depth --depth depth", "capture", "arrays", "arrays/a.npy"])
def test_depth_without_pictures_needs_no_option(run_cli: Cli, folder: Path, given: str) -> None:
    (folder / "capture").mkdir()
    shutil.copytree(folder / "depth", folder / "capture" / "depth")
    (folder / "arrays").mkdir()
    np.save(folder / "arrays" / "a.npy", calib.read_depth(folder / "depth" / "a.png"))
    done = run_cli("run", *given.split(), "--camera", "camera.json")
    assert done.code == 0, done.err
    assert "for depth images" in done.err
    lines = [json.loads(line) for line in done.out.splitlines()]
    assert lines[0]["frame"] == "a"
    assert len(lines) == (1 if "arrays" in given else 2)


def test_ground_that_is_curved_like_range_is_told(run_cli: Cli, model: Path, folder: Path) -> None:
    camera = calib.PinholeCamera(640, 360, 320.0, 320.0, 319.5, 179.5)
    calib.save_camera(folder / "wide.json", camera)
    rows, columns = np.mgrid[0:360, 0:640]
    rays = calib.pixels_to_rays(camera, np.stack([columns, rows], -1) + 0.5)
    depth_m = np.where(rays[..., 1] > 0.15, 2 / np.maximum(rays[..., 1], 0.15), 0)
    depth_m[50:300, 300:340] = 4.0
    said = []
    for kind in (depth_m, calib.depth_to_range(depth_m, camera)):
        for name in "ab":
            calib.write_depth(folder / "depth" / f"{name}.png", kind)
        run = (*FRAMES[:-1], "wide.json", "--model", model, "--up", "0,-1,0")
        done = run_cli(*run)
        assert done.code == 0, done.err
        said.append("give --depth-kind range" in done.err)
    assert said == [False, True]


def test_profiles_are_a_table_of_heights_and_diameters(
    run_cli: Cli, model: Path, folder: Path
) -> None:
    done = run_cli(*FRAMES, "--model", model, "--profiles", "profiles.csv", "--species", "birch")
    assert done.code == 0, done.err
    assert "profiles: profiles.csv" in done.err
    rows = _rows(folder / "profiles.csv")
    frames = [json.loads(line) for line in done.out.splitlines()]
    for frame in frames:
        for tree in frame["trees"]:
            metres = tree["metres"]
            assert metres["species"] == "birch"
            kept = [
                row
                for row in rows
                if (row["frame"], row["tree"]) == (frame["frame"], str(tree["tree"]))
            ]
            profile = metres.get("profile", {"height_m": [], "diameter_m": []})
            assert [float(row["height_m"]) for row in kept] == profile["height_m"]
            assert [float(row["diameter_m"]) for row in kept] == profile["diameter_m"]
            assert all(
                float(row["diameter_low95_m"])
                < float(row["diameter_m"])
                < float(row["diameter_high95_m"])
                for row in kept
            )
    assert rows


def test_without_depth_the_table_asks_for_depth(run_cli: Cli, model: Path, folder: Path) -> None:
    done = run_cli("run", "images", "--model", model, "--csv", "trees.csv")
    assert done.code == 0, done.err
    assert {row["diameter_failure"] for row in _rows(folder / "trees.csv")} == {
        "metres need depth: pass --depth and --camera; or without depth --camera-height or --marker"
    }


def test_unusable_depth_of_one_frame_does_not_stop_the_run(
    run_cli: Cli, model: Path, folder: Path
) -> None:
    calib.write_depth(folder / "depth" / "a.png", np.zeros((360, 640), np.float32))
    done = run_cli(*FRAMES, "--model", model)
    assert done.code == 0, done.err
    first, second = (json.loads(line)["trees"][0]["metres"] for line in done.out.splitlines())
    assert "no pixel has depth" in first["diameter_failure"]
    assert "diameter_m" in second
    assert "unusable depth in 1 frame: depth depth" in done.err


def test_cut_points_are_given_in_camera_and_machine_frame(
    run_cli: Cli, model: Path, folder: Path
) -> None:
    camera = calib.load_camera("camera.json")
    calib.save_camera("double.json", camera.scaled(1280, 720))
    calib.save_camera("half.json", camera.scaled(320, 180))
    calib.save_transform("still.json", calib.RigidTransform.identity())
    calib.save_transform("mounting.json", calib.RigidTransform.mounting((1.0, 0.0, 2.5)))
    for stem in "ab":
        depth_m = np.tile(np.linspace(3.99, 4.01, 320), (180, 1))
        calib.write_depth(folder / "depth" / f"{stem}.png", depth_m)
    rig = ("--depth-camera", "half.json", "--depth-extrinsics", "still.json")
    more = ("--mounting", "mounting.json", "--model", model)
    done = run_cli(*FRAMES[:-1], "double.json", *rig, *more)
    assert done.code == 0, done.err
    metres = json.loads(done.out.splitlines()[0])["trees"][0]["metres"]
    assert metres["diameter_m"] == pytest.approx(0.2, abs=0.03)
    x, y, z = metres["cut_point_m"]
    expected = (1.0 + z, -x, 2.5 - y)
    assert metres["cut_point_machine_m"] == pytest.approx(expected, abs=1e-6)
    assert "scaled to 640x360 px" in done.err
    following = done.err.splitlines()[-1].removeprefix("next: edgetree ")
    again = run_cli(*shlex.split(following))
    assert again.code == 0, again.err
    assert (folder / "images_trees" / "a_trees.jpg").exists()


def test_missing_depth_of_any_frame_is_reported(run_cli: Cli, model: Path, folder: Path) -> None:
    first = cv2.imread("images/a.jpg")
    assert first is not None
    cv2.imwrite("images/a.jpg", cv2.resize(first, (320, 180)))
    calib.write_depth("depth/a.png", np.tile(np.linspace(3.99, 4.01, 320), (180, 1)))
    done = run_cli(*FRAMES, "--model", model)
    assert done.code == 0, done.err
    assert "the camera is for 640x360 px: scaled to 320x180 px" in done.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--depth-camera", "camera.json"), "--depth-camera given without --depth"),
        (("--depth", "depth", "--depth-camera", "camera.json"), "given without --camera"),
        (("--csv", "camera.json/x"), "camera.json/x cannot be written"),
        (("--mounting", "none.json"), "none.json: no such file"),
        (("--csv", "x", "--jsonl", "./x"), "--csv is x, which is --jsonl x too: expected another"),
        (("--csv", "images/a.jpg"), "--csv is images/a.jpg, which is a file of source images too"),
        (("--out", "images"), "--out is images, which is source images too: expected another path"),
    ],
)
def test_contradicting_options_are_one_line(
    run_cli: Cli, model: Path, folder: Path, arguments: tuple[str, ...], message: str
) -> None:
    done = run_cli("run", "images", "--model", model, *arguments)
    assert (done.code, done.out) == (2, "")
    assert message in done.err
    assert done.err.count("\n") == 1
