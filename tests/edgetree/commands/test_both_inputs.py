"""`run`, `measure` and `live` with a model of colour and depth: each frame takes what is there."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib
from edgetree.frames.frame import Frame, stream_frame
from edgetree.live.pipeline import LivePipeline
from edgetree.model_file.manifest import Manifest
from edgetree.results.json_records import live_record
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import FakeSession

Cli = Callable[..., Any]
RIG = ("--camera", "camera.json")


@pytest.fixture
def folder(images: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to the folder with `images`, `depth` and `camera.json`, with grey pictures."""
    monkeypatch.chdir(images.parent)
    for path in sorted(images.glob("*")):
        height, width = cv2.imread(str(path)).shape[:2]
        picture = np.full((height, width, 3), 120, np.uint8)
        picture[::2] //= 2
        cv2.imwrite(str(path), picture)
    return images.parent


@pytest.fixture
def model(both_manifest: Manifest, write_model: Callable[..., Path]) -> Path:
    return write_model(both_manifest, "edge-n.onnx")


def lines(done: Any) -> list[dict[str, Any]]:
    assert done.code == 0, done.err
    return [json.loads(line) for line in done.out.splitlines()]


def picture_of(folder: Path, name: str) -> Path:
    return next((folder / "images").glob(f"{name}.*"))


def test_run_takes_both_and_says_when_one_is_black(run_cli: Cli, model: Path, folder: Path) -> None:
    found = lines(run_cli("run", "images", "--depth", "depth", *RIG, "--model", model))
    assert [len(each["trees"]) for each in found] == [1, 1]
    assert not any("alone" in each for each in found)
    black = picture_of(folder, "b")
    cv2.imwrite(str(black), cv2.imread(str(black)) * 0)
    done = run_cli(
        "run", "images", "--depth", "depth", *RIG, "--model", model, "--report", "r.html"
    )
    alone = [each.get("alone") for each in lines(done)]
    reason = "the picture is black, but for 0 %"
    assert alone == [None, {"image": "depth", "reason": reason}]
    assert "1 of 2 frames without one of colour and depth, the first: b found by depth" in done.err
    assert f"found by depth alone: {reason}" in (folder / "r.html").read_text("utf-8")
    assert "for colour and depth images" in done.err


def test_run_without_depth_goes_on_with_colour(run_cli: Cli, model: Path, folder: Path) -> None:
    found = lines(run_cli("run", "images", "--model", model))
    assert [each["alone"]["image"] for each in found] == ["colour", "colour"]
    assert found[0]["alone"]["reason"] == "there is no depth"


def test_measure_says_which_one_it_used(run_cli: Cli, model: Path, folder: Path) -> None:
    picture = picture_of(folder, "a")
    given = ("measure", picture, "--depth", "depth/a.png", *RIG, "--model", model)
    assert "alone" not in run_cli(*given).err
    cv2.imwrite(str(picture), cv2.imread(str(picture)) * 0)
    done = run_cli(*given)
    assert done.code == 0, done.err
    assert "found by depth alone: the picture is black" in done.err


def frames(count: int) -> Iterator[Frame]:
    """A stream that loses its depth half way, and its colour in the last frame."""
    camera = calib.PinholeCamera(640, 360, 400.0, 400.0, 319.5, 179.5)
    image = np.full((360, 640, 3), 120, np.uint8)
    image[::2] //= 2
    depth_m = np.tile(np.linspace(5.9, 6.1, 640, dtype=np.float32), (360, 1))
    for number in range(count):
        given = {"image": image, "depth_m": depth_m}
        if number == count - 1:
            given["image"] = None
        elif number >= count // 2:
            given["depth_m"] = None
        yield stream_frame(number=number, time_s=number / 10, camera=camera, **given)


class Stream:
    name, is_live, counts = "a stream", False, {}

    def __iter__(self) -> Iterator[Frame]:
        return frames(6)

    def close(self) -> None:
        pass


def test_a_stream_that_loses_one_of_the_two_goes_on(
    both_manifest: Manifest, two_trees: dict[str, Any]
) -> None:
    detector = TreeDetector(FakeSession.with_trees(both_manifest, **two_trees))
    results = list(LivePipeline(Stream, detector))
    records = [live_record(result) for result in results]
    assert [len(each["trees"]) for each in records] == [1] * 6
    used = [each["alone"]["image"] if "alone" in each else "both" for each in records]
    assert used == ["both"] * 3 + ["colour"] * 2 + ["depth"]


def test_unusable_depth_is_left_out_with_its_reason(
    run_cli: Cli, model: Path, folder: Path
) -> None:
    calib.write_depth(folder / "depth" / "a.png", np.zeros((360, 640), np.float32))
    found = lines(run_cli("run", "images", "--depth", "depth", *RIG, "--model", model))
    assert found[0]["alone"]["image"] == "colour"
    assert found[0]["alone"]["reason"]
    assert "alone" not in found[1]


def test_bench_runs_it(run_cli: Cli, model: Path) -> None:
    done = run_cli("bench", model, "--seconds", 0.2, "--json")
    assert done.code == 0, done.err
    assert "both" in done.out
