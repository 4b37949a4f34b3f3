"""Shared fixtures: manifests, small model files and a function that runs the command line."""

from __future__ import annotations

import dataclasses
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from both_model import manifest_of_both, model_bytes
from numpy.typing import NDArray
from schema_check import check_printed

import calib
import edgetree.frames.references
import edgetree.frames.rig
from edgetree import cli
from edgetree.catalogue import default_model
from edgetree.detections import KEYPOINT_NAMES
from edgetree.model_file.inputs_outputs import standard_input, standard_outputs
from edgetree.model_file.manifest import METADATA_KEY, Manifest, ResizeRule, Thresholds
from edgetree.model_file.safety_check import read_model_file
from edgetree.samples import sample_frames

ModelWriter = Callable[..., Path]


class Done(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


Cli = Callable[..., Done]


@pytest.fixture(autouse=True)
def nothing_told() -> None:
    """Forgets what this process has told once, so that a test hears it whatever ran before."""
    for module in (edgetree.frames.rig, edgetree.frames.references):
        for told in vars(module).values():
            if hasattr(told, "cache_clear") and told.__module__ == module.__name__:
                told.cache_clear()


@pytest.fixture
def run_cli(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Cli:
    """A function that runs `edgetree` with the given arguments."""

    def run(*arguments: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["edgetree", *map(str, arguments)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capfd.readouterr()
        assert isinstance(ended.value.code, int)
        check_printed(arguments, out)
        return Done(ended.value.code, out, err)

    return run


@pytest.fixture
def model(rgb_manifest: Manifest, write_model: ModelWriter) -> Path:
    """A model file that finds one tree with a high score in every colour image."""
    return write_model(rgb_manifest)


@pytest.fixture
def images(tmp_path: Path) -> Path:
    """A folder with two images, their depth images of about 4 m in `depth`, and a camera."""
    rng = np.random.default_rng(0)
    for folder in ("images", "depth"):
        (tmp_path / folder).mkdir()
    for stem in ("a", "b"):
        pixels = rng.integers(0, 256, (360, 640, 3), np.uint8)
        cv2.imwrite(str(tmp_path / "images" / f"{stem}.jpg"), pixels)
        depth_m = np.tile(np.linspace(3.99, 4.01, 640, dtype=np.float32), (360, 1))
        calib.write_depth(tmp_path / "depth" / f"{stem}.png", depth_m)
    camera = calib.PinholeCamera(640, 360, 400.0, 400.0, 319.5, 179.5)
    calib.save_camera(tmp_path / "camera.json", camera)
    return tmp_path / "images"


@pytest.fixture
def rgb_manifest() -> Manifest:
    """The manifest of an rgb model with an input of 640x384 px and 20 output rows."""
    shipped = read_model_file(default_model("rgb"))
    return Manifest(
        name="test-rgb",
        backbone="none",
        modality="rgb",
        input=standard_input("rgb", 384, 640),
        resize=ResizeRule(pad_value=114),
        mean=(103.5, 116.3, 123.7),
        std=(57.4, 57.1, 58.4),
        depth_encoding=None,
        outputs=standard_outputs(20),
        classes=("tree",),
        keypoint_names=KEYPOINT_NAMES,
        keypoint_flip_pairs=((1, 2),),
        thresholds=Thresholds(score=0.01, nms_iou=0.5),
        precision="float32",
        opset=18,
        parameters=1234,
        weights_sha256="0" * 64,
        training_data="none",
        project_version="0.1.0",
        parity=Manifest.from_json(shipped.metadata[METADATA_KEY]).parity,
    )


@pytest.fixture
def depth_manifest(rgb_manifest: Manifest) -> Manifest:
    """The manifest of a depth model, otherwise like `rgb_manifest`."""
    return dataclasses.replace(
        rgb_manifest,
        name="test-depth",
        modality="depth",
        input=standard_input("depth", 384, 640),
        resize=ResizeRule(pad_value=255),
        mean=(127.5,),
        std=(60.0,),
        depth_encoding={
            "near_m": 0.0,
            "far_m": 20.0,
            "near_value": 0,
            "far_value": 255,
            "invalid_value": 255,
        },
        training_data="none",
    )


@pytest.fixture
def both_manifest(depth_manifest: Manifest) -> Manifest:
    """The manifest of a model of colour and depth, otherwise like `depth_manifest`."""
    return manifest_of_both(depth_manifest)


@pytest.fixture
def write_model(tmp_path: Path, two_trees: dict[str, NDArray[np.float32]]) -> ModelWriter:
    """A function that writes a model which finds `two_trees` in every image."""

    def write(
        manifest: Manifest,
        name: str = "model.onnx",
        *,
        with_manifest: bool = True,
        batch: int | str = "batch",
    ) -> Path:
        content = model_bytes(manifest, two_trees, batch)
        if not with_manifest:
            content = content.replace(METADATA_KEY.encode(), b"x" * len(METADATA_KEY))
        path = tmp_path / name
        path.write_bytes(content)
        return path

    return write


@pytest.fixture
def two_trees() -> dict[str, NDArray[np.float32]]:
    """Trees with a high and a low score, in pixels of a 640x384 px input."""
    keypoints = [
        [[110, 300, 0.9], [100, 280, 0.8], [120, 280, 0.8], [110, 230, 0.7], [110, 180, 1]]
    ]
    return {
        "boxes": np.array([[100, 50, 120, 310], [400, 100, 430, 300]], np.float32),
        "scores": np.array([0.9, 0.3], np.float32),
        "keypoints": np.array(keypoints * 2, np.float32),
    }


@pytest.fixture
def write_drive(tmp_path: Path) -> Callable[..., Path]:
    """A function that writes a dataset of drives, in the form of the simulator."""

    def write(scenes: int = 1, frames: int = 3, step_m: float = 1.0) -> Path:
        folder = tmp_path / "drives"
        sample = sample_frames()[0]
        for name in ("images", "depth", "imu"):
            (folder / name).mkdir(parents=True)
        images = []
        for number in range(frames * scenes):
            shutil.copy(sample.image_path, folder / f"images/{number:06d}.jpg")
            shutil.copy(sample.depth_path, folder / f"depth/{number:06d}.png")
            # Rows: right, down and forward of a level camera that looks along the world's y.
            images.append(
                {
                    "file_name": f"images/{number:06d}.jpg",
                    "depth_file": f"depth/{number:06d}.png",
                    "camera": sample.camera.to_dict(),
                    "up_camera": [0.0, -1.0, 0.0],
                    "time_s": 0.1 * (frames - 1 - number % frames),
                    "pose_world": {
                        "origin_m": [number * step_m, 0.0, 2.0],
                        "rotation": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
                    },
                    "imu_file": f"imu/{number // frames:06d}.csv",
                }
            )
        (folder / "test_RGB.json").write_text(json.dumps({"images": images}))
        return folder

    return write
