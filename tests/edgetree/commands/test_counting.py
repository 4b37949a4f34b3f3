"""Different trees in videos, and the model that is chosen or tried."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edgetree.commands.other_model import OtherModel
from edgetree.errors import SignatureError
from edgetree.samples import sample_frames

Cli = Callable[..., Any]


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slow turn over the first sample frame, six frames at 10 Hz."""
    path = tmp_path_factory.mktemp("video") / "walk.mp4"
    picture = cv2.resize(sample_frames()[0].image(), (800, 450))
    code = cv2.VideoWriter.fourcc(*"mp4v")
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, 10, (720, 450))
    for left in range(0, 72, 12):
        writer.write(picture[:, left : left + 720])
    writer.release()
    return path


def test_a_video_tells_how_many_different_trees_it_shows(
    run_cli: Cli, video: Path, tmp_path: Path
) -> None:
    files = ("--csv", tmp_path / "a.csv", "--out", tmp_path / "a.mp4")
    done = run_cli("run", video, "--report", tmp_path / "a.html", *files)
    assert done.code == 0, done.err
    records = [json.loads(line) for line in done.out.splitlines()]
    tracks = {tree["track"] for record in records for tree in record["trees"]} - {None}
    assert tracks == set(range(1, len(tracks) + 1))
    most = max(len(record["trees"]) for record in records)
    assert 2 <= len(tracks) <= most + 1
    assert f"about {len(tracks)} ± " in done.err
    assert "different trees" in done.err
    with (tmp_path / "a.csv").open(newline="") as stream:
        assert {row["track"] for row in csv.DictReader(stream)} == {"", *map(str, tracks)}
    assert f"about {len(tracks)}" in (tmp_path / "a.html").read_text()
    drawn = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert (drawn.get(cv2.CAP_PROP_FRAME_COUNT), drawn.get(cv2.CAP_PROP_FPS)) == (6, 10)
    drawn.release()


def test_live_takes_a_video_as_it_is_and_numbers_its_stems(
    run_cli: Cli, video: Path, tmp_path: Path
) -> None:
    done = run_cli("live", video, "--csv", tmp_path / "a.csv")
    assert done.code == 0, done.err
    last = json.loads(done.out.splitlines()[-1])
    numbers = [tree["track"] for tree in last["trees"]]
    assert any(numbers)
    assert "different trees" in done.err
    with (tmp_path / "a.csv").open(newline="") as stream:
        assert {row["track"] for row in csv.DictReader(stream)} >= {
            str(number) for number in numbers if number is not None
        }


@pytest.mark.parametrize("output", ["--map m.geojson", "--report r.html"])
def test_live_says_at_once_that_places_need_depth(
    run_cli: Cli, video: Path, output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run_cli("live", video, *output.split())
    assert (done.code, done.out) == (2, "")
    assert f"{output.split()[0]} needs stems in metres, and {video} has no depth" in done.err
    assert not list(tmp_path.iterdir())


def test_pictures_in_no_order_may_repeat_trees(run_cli: Cli, images: Path, model: Path) -> None:
    done = run_cli("run", images, "--model", model)
    assert done.code == 0, done.err
    assert "the same trees may be in several" in done.err
    assert '"track"' not in done.out
    done = run_cli("run", images, "--model", model, "--out", images.parent / "a.mp4")
    assert done.code == 2
    assert "pictures in no order: expected a folder" in done.err


def test_several_videos_are_no_pictures(run_cli: Cli, video: Path, model: Path) -> None:
    other = video.with_name("other.mp4")
    other.write_bytes(video.read_bytes())
    done = run_cli("run", video, other, "--model", model)
    assert done.code == 0, done.err
    assert "several sources: the same trees may be in several of them" in done.err


@pytest.fixture
def hidden_from_depth(tmp_path: Path) -> tuple[object, ...]:
    """A frame whose depth is a smooth wall, in which a depth model finds nothing."""
    sample = sample_frames()[0]
    height, width = sample.image().shape[:2]
    depth_mm = np.tile(np.linspace(7000, 4000, height)[:, None], (1, width)).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "depth.png"), depth_mm)
    camera = {"schema": "calib.camera/1", **sample.camera.to_dict()}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    rig = ("--depth", tmp_path / "depth.png", "--camera", tmp_path / "camera.json")
    return sample.image_path, *rig


def test_the_other_model_is_tried_where_the_chosen_one_finds_nothing(
    run_cli: Cli, hidden_from_depth: tuple[object, ...]
) -> None:
    done = run_cli("measure", *hidden_from_depth, "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["model"]["name"] == "edge-s-rgb"
    assert "measured with edge-s-rgb: edge-s-rgb measures" in done.err
    assert "edge-n-depth 0; --model edge-n-depth takes that one" in done.err


def test_a_model_that_was_asked_for_stays_and_the_other_one_is_named(
    run_cli: Cli, hidden_from_depth: tuple[object, ...]
) -> None:
    done = run_cli("measure", *hidden_from_depth, "--model", "depth", "--json")
    assert json.loads(done.out)["model"]["name"] == "edge-n-depth"
    assert "edge-n-depth 0: give --model edge-s-rgb" in done.err
    done = run_cli("run", *hidden_from_depth)
    assert "--model edge-s-rgb is better in 1 of 1 frame tried" in done.err


def test_a_model_that_cannot_be_tried_is_named_with_the_reason(
    run_cli: Cli, hidden_from_depth: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: OtherModel) -> None:
        raise SignatureError("model edge-s-rgb.onnx has no signature")

    monkeypatch.setattr(OtherModel, "opened", refuse)
    for command in ("measure", "run"):
        done = run_cli(command, *hidden_from_depth)
        assert done.code == 0, done.err
        told = "--model edge-s-rgb was not tried, although it may find more: model edge-s-rgb.onnx"
        assert done.err.count(told) == 1


def test_a_video_is_not_told_to_pass_depth_images(run_cli: Cli, video: Path) -> None:
    done = run_cli("run", video)
    assert "metres need depth, and a video has none: expected a recording with depth" in done.err
    assert "--depth" not in done.err
    refused = run_cli("run", video, "--map", "stems.geojson")
    assert "follows stems without them, with depth or --camera-height" in refused.err
