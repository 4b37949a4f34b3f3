"""Tests of `edgetree measure`: table, files and errors."""

from __future__ import annotations

import csv
import json
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib
import edgetree.measure
from edgetree.detections import TreeDetections
from edgetree.measure import Estimate, Evidence, TreeMeasurement
from edgetree.model_file.manifest import Manifest
from edgetree.samples import sample_frames

Cli = Callable[..., Any]
Asked = dict[str, Any]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Asked:
    """Replace the measurement by fixed values and record its arguments."""
    received: Asked = {}

    def measure(trees: TreeDetections, depth_m: Any, camera: Any, **more: Any) -> Any:
        received.update(more, trees=trees, depth_m=depth_m, camera=camera)
        evidence = Evidence(
            method="mask + depth",
            arc_deg=90.0,
            valid_depth_share=0.8,
            visible_share=0.9,
            warnings=("a high stump",),
        )
        measured = replace(
            TreeMeasurement.failed("no ground"),
            diameter_m=Estimate(0.312, 0.008),
            distance_m=Estimate(4.0, 0.03),
            evidence=evidence,
        )
        return [measured] * len(trees)

    monkeypatch.setattr(edgetree.measure, "measure_trees", measure)
    return received


@pytest.fixture
def folder(images: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to the folder with `images`, `depth`, `camera.json` and other files."""
    here = images.parent
    mask = np.zeros((360, 640), np.uint8)
    mask[50:310, 100:120], mask[80:300, 400:430] = 3, 8
    cv2.imwrite(str(here / "mask.png"), mask)
    camera = calib.load_camera(here / "camera.json")
    calib.save_camera(here / "double.json", camera.scaled(1280, 720))
    calib.save_camera(here / "half.json", camera.scaled(320, 180))
    calib.save_camera(here / "square.json", replace(camera, width=360))
    calib.write_depth(here / "small.png", np.tile(np.linspace(3.9, 4.1, 320), (180, 1)))
    calib.write_depth(here / "holes.png", np.zeros((360, 640), np.float32))
    (here / "text.json").write_text("{}")
    transform = calib.RigidTransform.mounting((1.0, 0.0, 2.5))
    calib.save_transform(here / "mounting.json", transform)
    monkeypatch.chdir(here)
    return here


IMAGE = ("measure", "images/a.jpg", "--depth", "depth/a.png", "--camera", "camera.json")


def test_a_sample_is_measured_with_a_packaged_model(run_cli: Cli, tmp_path: Path) -> None:
    frame = sample_frames()[0]
    calib.save_camera(tmp_path / "camera.json", frame.camera)
    up = ",".join(map(str, frame.up_camera))
    done = run_cli(
        *("measure", frame.image_path, "--depth", frame.depth_path, "--up", up),
        *("--camera", tmp_path / "camera.json", "--model", "depth", "--threads", 1),
        *("--out", tmp_path / "trees.png", "--csv", tmp_path / "trees.csv", "--json"),
    )
    assert done.code == 0, done.err
    record = json.loads(done.out)
    assert (record["schema"], record["model"]["modality"]) == ("edgetree.measure/1", "depth")
    trees = record["frame"]["trees"]
    measured = [tree["metres"] for tree in trees if "diameter_m" in tree["metres"]]
    assert len(measured) >= 5
    assert all(0.05 < metres["diameter_m"] < 1.0 for metres in measured)
    assert all(metres["evidence"]["method"] for metres in measured)
    rows = list(csv.DictReader((tmp_path / "trees.csv").open(newline="", encoding="utf-8")))
    assert [int(row["tree"]) for row in rows] == [tree["tree"] for tree in trees]
    picture, plain = cv2.imread(str(tmp_path / "trees.png")), frame.image()
    assert picture is not None
    assert picture.shape == plain.shape
    assert (picture != plain).any(axis=2).mean() > 0.05


def test_the_table_and_the_next_command_are_printed(
    run_cli: Cli, model: Path, folder: Path, asked: Asked
) -> None:
    done = run_cli(*IMAGE, "--model", model)
    assert done.code == 0, done.err
    assert re.search(r"^ +1 +31\.2 ± 0\.8 cm +– +– +– +4\.00 ± 0\.03 m$", done.out, re.MULTILINE)
    assert "no DBH, cut height, lean, axis distance, taper, seen volume: no ground" in done.out
    assert "warning: a high stump" in done.out
    following = ""
    for file in ("a_trees.jpg", "a_trees.csv"):
        following = done.err.splitlines()[-1].removeprefix("next: edgetree ")
        done = run_cli(*shlex.split(following))
        assert done.code == 0, done.err
        assert (folder / file).exists()


def test_a_mask_is_measured_without_a_model(run_cli: Cli, folder: Path, asked: Asked) -> None:
    done = run_cli(*IMAGE, "--mask", "mask.png", "--out", "out.jpg", "--json")
    assert done.code == 0, done.err
    assert asked["trees"].keypoints_px is None
    assert asked["masks"].shape == (2, 360, 640)
    assert asked["masks"].sum(axis=(1, 2)).tolist() == [260 * 20, 220 * 30]
    record = json.loads(done.out)
    assert record["mask"] == "mask.png"
    assert [tree["tree"] for tree in record["frame"]["trees"]] == [3, 8]
    assert record["frame"]["trees"][0]["box_px"] == [100, 50, 120, 310]
    assert record["frame"]["trees"][0]["mask_rle"]["size"] == [360, 640]
    drawn, plain = cv2.imread("out.jpg"), cv2.imread("images/a.jpg")
    assert drawn is not None
    assert plain is not None
    assert np.abs(drawn[100:290, 400:430].astype(int) - plain[100:290, 400:430]).mean() > 20


def test_the_camera_options_are_passed_to_the_measurement(
    run_cli: Cli, model: Path, folder: Path, asked: Asked
) -> None:
    options = ("--up", "0,-1,0", "--mounting", "mounting.json", "--stump-height", 0.2)
    options += ("--ground-cover", "0.3,0.05")
    done = run_cli(*IMAGE, "--model", model, *options)
    assert done.code == 0, done.err
    assert tuple(asked["up_camera"]) == (0, -1, 0)
    np.testing.assert_allclose(asked["mounting"].translation_m, (1.0, 0.0, 2.5))
    assert asked["settings"].max_stump_height_m == 0.2
    assert asked["settings"].ground_cover_m == 0.3
    assert asked["settings"].ground_cover_std_m == 0.05
    assert asked["camera"] == calib.load_camera("camera.json")


def test_scaling_of_the_camera_is_reported(
    run_cli: Cli, model: Path, folder: Path, asked: Asked
) -> None:
    done = run_cli(*IMAGE[:-1], "double.json", "--model", model)
    assert done.code == 0, done.err
    assert asked["camera"] == calib.load_camera("camera.json")
    assert "the camera is for 1280x720 px: scaled to 640x360 px, like the image" in done.err


def test_depth_of_another_camera_is_registered(
    run_cli: Cli, model: Path, folder: Path, asked: Asked
) -> None:
    small = ("measure", "images/a.jpg", "--depth", "small.png", "--camera", "camera.json")
    done = run_cli(*small, "--depth-camera", "half.json", "--model", model)
    assert done.code == 0, done.err
    assert asked["depth_m"].shape == (360, 640)
    np.testing.assert_allclose(asked["depth_m"][180, [100, 500]], [3.931, 4.057], atol=2e-3)


def test_one_camera_of_several_is_chosen_by_name(
    run_cli: Cli, model: Path, folder: Path, asked: Asked
) -> None:
    lens = {
        "camera_model": "pinhole",
        "distortion_model": "radtan",
        "distortion_coeffs": [0, 0, 0, 0],
        "resolution": [640, 360],
    }
    chain = {
        f"cam{index}": {**lens, "intrinsics": [f, f, 319.5, 179.5]}
        for index, f in enumerate((300, 400))
    }
    (folder / "chain.json").write_text(json.dumps(chain))
    both = run_cli(*IMAGE[:-1], "chain.json", "--model", model)
    assert both.code == 2
    assert "chain.json: holds 2 cameras, expected one of the names 'cam0', 'cam1'" in both.err
    done = run_cli(*IMAGE[:-1], "chain.json:cam1", "--model", model)
    assert done.code == 0, done.err
    assert asked["camera"].fx == 400


def test_a_depth_model_detects_in_the_depth_image(
    run_cli: Cli,
    depth_manifest: Manifest,
    write_model: Callable[..., Path],
    folder: Path,
    asked: Asked,
) -> None:
    model = write_model(depth_manifest, "depth.onnx")
    done = run_cli("measure", "depth/a.png", "--camera", "camera.json", "--model", model)
    assert done.code == 0, done.err
    assert asked["depth_m"].shape == (360, 640)


BAD_INPUTS = {
    "no camera": (
        "images/a.jpg --depth depth/a.png",
        "--camera is missing: expected the camera file",
    ),
    "neither depth nor camera": (
        "images/a.jpg",
        "--camera is missing: expected .*; and --depth unless the image holds depth, or without",
    ),
    "no depth": ("images/a.jpg --camera camera.json", "--depth is missing: expected the depth"),
    "a folder": (
        "images --depth depth --camera camera.json",
        "images is not an image: expected one;",
    ),
    "a missing image": ("c.jpg --depth depth/a.png --camera camera.json", r"c\.jpg does not exist"),
    "a missing image before a missing camera": ("c.jpg", r"c\.jpg does not exist"),
    "a missing depth": ("images/a.jpg --depth c.png --camera camera.json", r"c\.png is not a file"),
    "depth full of holes": (
        "images/a.jpg --depth holes.png --camera camera.json",
        r"holes\.png: no pixel has depth: expected",
    ),
    "depth in another unit": (
        "images/a.jpg --depth depth/a.png --camera camera.json --depth-scale 1",
        r"a\.png: the median depth is 4000 m: expected metres; .*millimetres",
    ),
    "a scale of nothing": (
        "images/a.jpg --depth depth/a.png --camera camera.json --depth-scale 0",
        "--depth-scale is 0.0: expected metres per unit",
    ),
    "depth of another size": (
        "images/a.jpg --depth small.png --camera camera.json",
        r"small\.png is 320x180 px: expected 640x360 px.*pass --depth-camera",
    ),
    "a camera of another aspect": (
        "images/a.jpg --depth depth/a.png --camera square.json",
        r"a\.jpg: the camera is for 360x360 px and the image is 640x360: expected the same aspect",
    ),
    "no camera file": (
        "images/a.jpg --depth depth/a.png --camera text.json",
        r"text\.json: no known camera format, expected",
    ),
    "no transform": (
        "images/a.jpg --depth depth/a.png --camera camera.json --mounting camera.json",
        r"camera\.json: schema is 'calib.camera/1', expected 'calib.transform/1'",
    ),
    "extrinsics of nothing": (
        "images/a.jpg --depth depth/a.png --camera camera.json --depth-extrinsics mounting.json",
        "--depth-extrinsics given without --depth-camera",
    ),
    "a depth camera without depth": (
        "images/a.jpg --camera camera.json --model depth --depth-camera half.json",
        "--depth-camera given without --depth",
    ),
    "a model beside a mask": (
        "images/a.jpg --depth depth/a.png --camera camera.json --model rgb --mask mask.png",
        "--model given with --mask: expected only one",
    ),
    "a mask without depth": (
        "images/a.jpg --camera camera.json --mask mask.png",
        "--mask given without --depth",
    ),
    "a mask of another size": (
        "images/a.jpg --depth depth/a.png --camera camera.json --mask small.png",
        r"mask small\.png is 320x180 px: expected 640x360 px",
    ),
    "a picture of another kind": (
        "images/a.jpg --depth depth/a.png --camera camera.json --out trees.gif",
        r"--out is trees\.gif: expected a file name ending in \.jpg",
    ),
    "a table under a file": (
        "images/a.jpg --depth depth/a.png --camera camera.json --mask mask.png"
        " --out out.jpg --csv camera.json/x.csv",
        r"camera\.json.x\.csv cannot be written",
    ),
    "a picture under a file": (
        "images/a.jpg --depth depth/a.png --camera camera.json --mask mask.png"
        " --csv trees.csv --out camera.json/x.jpg",
        r"camera\.json.x\.jpg cannot be written",
    ),
    "a stump of no height": (
        "images/a.jpg --depth depth/a.png --camera camera.json --stump-height 0",
        "--stump-height is 0: expected metres above 0",
    ),
    "a cover without a deviation": (
        "images/a.jpg --depth depth/a.png --camera camera.json --ground-cover 0.3",
        "--ground-cover is '0.3': expected a height and its standard deviation in metres",
    ),
    "a picture over the mask": (
        "images/a.jpg --depth depth/a.png --camera camera.json --mask mask.png --out mask.png",
        r"--out is mask\.png, which is --mask mask\.png too: expected another path",
    ),
    "a table over the camera": (
        "images/a.jpg --depth depth/a.png --camera camera.json --csv images/../camera.json",
        r"which is --camera camera\.json too: expected another path",
    ),
    "one file for picture and table": (
        "images/a.jpg --depth depth/a.png --camera camera.json --out a.png --csv ./a.png",
        r"--csv is a\.png, which is --out a\.png too: expected another path",
    ),
    "an up that is no direction": (
        "images/a.jpg --depth depth/a.png --camera camera.json --up north",
        "--up is 'north': expected three numbers",
    ),
}


@pytest.mark.parametrize("case", BAD_INPUTS)
def test_bad_input_gives_one_line_and_no_files(
    run_cli: Cli, folder: Path, asked: Asked, case: str
) -> None:
    before = sorted(folder.rglob("*"))
    arguments, message = BAD_INPUTS[case]
    done = run_cli("measure", *arguments.split())
    assert done.code == 2
    assert done.out == ""
    assert done.err.count("\n") == 1, done.err
    assert re.search(message, done.err), done.err
    assert sorted(folder.rglob("*")) == before
