"""`edgetree run` on recordings and drives, and maps of their stems."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]
WriteDrive = Callable[..., Path]


def trees(line: str) -> list[object]:
    return [(tree["score"], tree["box_px"], tree["metres"]) for tree in json.loads(line)["trees"]]


def test_a_drive_brings_its_depth_camera_and_time(
    run_cli: Cli, write_drive: WriteDrive, tmp_path: Path
) -> None:
    folder = write_drive()
    files = (
        "--csv",
        tmp_path / "t.csv",
        "--out",
        tmp_path / "drawn",
        "--report",
        tmp_path / "r.html",
    )
    done = run_cli("run", folder, "--model", "depth", *files)
    assert done.code == 0, done.err
    records = [json.loads(line) for line in done.out.splitlines()]
    assert [(record["frame"], record["time_s"]) for record in records] == [
        ("000002", 0.0),
        ("000001", 0.1),
        ("000000", 0.2),
    ]
    assert records[0]["path"] == str(folder / "images" / "000002.jpg")
    assert any("diameter_m" in tree["metres"] for tree in records[0]["trees"])
    with (tmp_path / "t.csv").open(newline="") as stream:
        assert {row["frame"] for row in csv.DictReader(stream)} == {"000000", "000001", "000002"}
    assert len(list((tmp_path / "drawn").iterdir())) == 3
    assert (tmp_path / "r.html").read_text().count("<figure") == 3


def test_a_recording_gives_the_trees_that_were_recorded(
    run_cli: Cli, write_drive: WriteDrive, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    folder = write_drive()
    whole = run_cli("run", folder, "--model", "depth")
    live = run_cli("live", folder, "--record", tmp_path / "kept", "--record-all")
    assert live.code == 0, live.err
    (recording,) = (tmp_path / "kept").iterdir()
    done = run_cli("run", recording, "--model", "depth")
    assert done.code == 0, done.err
    names = [json.loads(line)["frame"] for line in done.out.splitlines()]
    assert names == [f"{recording.name}_{number:06d}" for number in range(3)]
    assert [*map(trees, done.out.splitlines())] == [*map(trees, whole.out.splitlines())]


def test_a_recording_without_depth_says_what_metres_need(
    run_cli: Cli, images: Path, model: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    assert run_cli("live", images, "--model", model, "--bag", tmp_path / "bag").code == 0
    done = run_cli("run", tmp_path / "bag", "--model", model)
    assert done.code == 0, done.err
    assert "metres need depth with each frame" in done.err


def test_the_map_is_that_of_live(run_cli: Cli, write_drive: WriteDrive, tmp_path: Path) -> None:
    folder = write_drive(frames=6, step_m=0.0)
    of_run, of_live = tmp_path / "run.geojson", tmp_path / "live.geojson"
    done = run_cli("run", folder, "--model", "depth", "--map", of_run, "--json")
    assert done.code == 0, done.err
    assert f"map: {of_run}" in done.err
    assert json.loads(done.out)["map"] == str(of_run)
    assert run_cli("live", folder, "--map", of_live).code == 0
    assert json.loads(of_run.read_text())["features"]
    assert of_run.read_bytes() == of_live.read_bytes()


def test_a_map_of_a_recording_without_poses_is_refused(
    run_cli: Cli, images: Path, model: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    assert run_cli("live", images, "--model", model, "--bag", tmp_path / "bag").code == 0
    stems, table = tmp_path / "stems.geojson", tmp_path / "trees.csv"
    done = run_cli("run", tmp_path / "bag", "--model", model, "--map", stems, "--csv", table)
    assert (done.code, done.out.count("\n")) == (2, 2)
    assert "frame bag_000000 and those after it have no pose: expected" in done.err
    assert not stems.exists()
    assert not table.exists()


MISTAKES = {
    "map of images": ("images", ("--map", "a.geojson"), "has no poses: expected a recording or a"),
    "map in another format": (
        "drives",
        ("--map", "a.shp"),
        "map (--map) is a.shp: expected a",
    ),
    "scene of images": ("images", ("--scene", "1"), "expected it for datasets of drives alone"),
    "scene that is not there": ("drives", ("--scene", "7"), "has no scene 7: expected one of 0"),
    "topic of a drive": ("drives", ("--topic", "imu=/imu"), "expected it for recordings alone"),
    "topic with another role": ("drives", ("--topic", "a=/b"), "--topic is 'a=/b': expected ROLE="),
    "depth of a drive": ("drives", ("--depth", "drives/depth"), "expected it for images alone"),
    "shards": ("drives", ("--scene", "0", "--shards", "p"), "--scene given with --shards"),
    "coco of a recording": ("a.mcap", ("--coco", "c.json"), "is a recording: expected images"),
    "a recording that is not there": ("a.mcap", (), "recording a.mcap does not exist: expected"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_give_one_line(
    run_cli: Cli,
    images: Path,
    model: Path,
    write_drive: WriteDrive,
    monkeypatch: pytest.MonkeyPatch,
    mistake: str,
) -> None:
    pytest.importorskip("rosbags")
    write_drive()
    source, options, message = MISTAKES[mistake]
    monkeypatch.chdir(images.parent)
    done = run_cli("run", source, "--model", model, *options)
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1, done.err
    assert re.search(re.escape(message), done.err), done.err


def test_live_writes_a_report_of_the_stems(
    run_cli: Cli, write_drive: WriteDrive, tmp_path: Path
) -> None:
    report = tmp_path / "stems.html"
    done = run_cli(
        "live", write_drive(frames=6, step_m=0.0), "--report", report, "--jsonl", tmp_path / "l"
    )
    assert done.code == 0, done.err
    lines = [json.loads(line) for line in (tmp_path / "l").read_text().splitlines()]
    confirmed = {
        track["track"]
        for line in lines
        for track in line["tracks"]
        if track["state"] == "confirmed"
    }
    page = report.read_text()
    rows = [int(number) for number in re.findall(r'data-name="tree" data-value="(\d+)"', page)]
    assert confirmed
    assert sorted(rows) == sorted(confirmed)
    assert page.count("<figure") <= len(confirmed)
    done = run_cli("live", "nowhere", "--report", tmp_path / "stems.txt")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "stems.txt: expected a file name ending in .html" in done.err
