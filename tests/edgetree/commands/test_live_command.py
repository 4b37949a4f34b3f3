"""`edgetree live`: outputs, the page, mistakes, and how it ends."""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from edgetree import TreeDetector
from edgetree.commands import live_run

Cli = Callable[..., Any]

MAIN = "from edgetree.cli import main; main()"


@pytest.fixture
def source(images: Path, model: Path) -> tuple[object, ...]:
    """Arguments for a folder with two frames, their depth and camera."""
    depth, camera = images.parent / "depth", images.parent / "camera.json"
    return images, "--depth", depth, "--camera", camera, "--model", model


def test_every_frame_is_one_line(run_cli: Cli, source: tuple[object, ...]) -> None:
    done = run_cli("live", *source)
    assert done.code == 0, done.err
    first, second = (json.loads(line) for line in done.out.splitlines())
    assert [first["schema"], first["frame"], second["frame"]] == ["edgetree.live/1", 0, 1]
    assert len(second["trees"]) == 1
    assert second["trees"][0]["metres"]["distance_m"] == pytest.approx(4.75, abs=0.1)
    assert "ended: 2 frames" in done.err


def test_people_at_a_terminal_get_a_short_line_for_each_frame(
    run_cli: Cli, source: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    first, second = run_cli("live", *source).out.splitlines()
    assert first.startswith("a: 1 tree, ")
    assert second.endswith("1 stem followed")


def test_results_go_to_files(run_cli: Cli, source: tuple[object, ...], tmp_path: Path) -> None:
    lines, table, stems = (tmp_path / name for name in ("a.jsonl", "a.csv", "a.geojson"))
    done = run_cli("live", *source, "--jsonl", lines, "--csv", table, "--map", stems)
    assert (done.code, done.out) == (0, "")
    assert {f"jsonl: {lines}", f"table: {table}", f"map: {stems}"} <= {*done.err.splitlines()}
    assert len(lines.read_text().splitlines()) == 2
    assert table.read_text().startswith("frame,")
    assert json.loads(stems.read_text())["type"] == "FeatureCollection"


def test_results_go_to_a_bag_that_is_a_source_again(
    run_cli: Cli, source: tuple[object, ...], model: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    assert run_cli("live", *source, "--bag", tmp_path / "bag").code == 0
    done = run_cli("live", tmp_path / "bag", "--model", model)
    assert done.code == 0, done.err
    assert [len(json.loads(line)["trees"]) for line in done.out.splitlines()] == [1, 1]


def test_motion_comes_from_depth_images_too(
    run_cli: Cli, source: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("small_gicp")
    from edgetree.frames.frame import Frame
    from edgetree.live.tracking.odometry import CameraStep, DepthOdometry

    seen: list[int] = []
    step = DepthOdometry.step

    def noted(odometry: DepthOdometry, frame: Frame, guess: CameraStep | None) -> Any:
        seen.append(frame.number)
        return step(odometry, frame, guess)

    monkeypatch.setattr(DepthOdometry, "step", noted)
    done = run_cli("live", *source, "--odometry")
    assert done.code == 0, done.err
    assert seen == [0, 1]


def test_a_missing_package_for_motion_is_named_in_one_line(
    run_cli: Cli, source: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    done = run_cli("live", *source, "--odometry")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "small_gicp: pip install" in done.err


def test_it_ends_after_some_frames(run_cli: Cli, source: tuple[object, ...]) -> None:
    done = run_cli("live", *source, "--loop", "--frames", 5)
    assert done.code == 0
    assert [json.loads(line)["frame"] for line in done.out.splitlines()] == [0, 1, 2, 3, 4]


def test_a_wrong_source_replaces_no_file(run_cli: Cli, model: Path, tmp_path: Path) -> None:
    stems = tmp_path / "stems.geojson"
    stems.write_text("of yesterday")
    done = run_cli("live", tmp_path / "no.mcap", "--model", model, "--map", stems)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "no.mcap" in done.err
    assert stems.read_text() == "of yesterday"


def test_an_output_without_a_folder_moves_no_results_aside(
    run_cli: Cli, source: tuple[object, ...], tmp_path: Path
) -> None:
    lines = tmp_path / "lines.jsonl"
    lines.write_text("of yesterday")
    before = sorted(tmp_path.rglob("*"))
    stems = tmp_path / "none" / "stems.geojson"
    done = run_cli("live", *source, "--jsonl", lines, "--map", stems)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "stems.geojson cannot be written" in done.err
    assert lines.read_text() == "of yesterday"
    assert sorted(tmp_path.rglob("*")) == before


def test_what_depth_makes_needless_is_said(
    run_cli: Cli, source: tuple[object, ...], tmp_path: Path
) -> None:
    done = run_cli("live", *source, "--camera-height", "1.6")
    assert done.code == 2
    assert "--depth given with an option for pictures without depth" in done.err


def test_a_wrong_source_gives_one_line_with_a_recorder_too(
    run_cli: Cli, model: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    folder = tmp_path / "recordings"
    done = run_cli("live", tmp_path / "no.mcap", "--model", model, "--record", folder)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert not folder.exists()


MISTAKES = {
    "topic": (("--topic", "color=/camera"), r"--topic is 'color=/camera': expected ROLE=NAME"),
    "topic for images": (("--topic", "colour=/camera"), "expected it for recordings alone"),
    "origin": (
        ("--map", "a.geojson", "--map-origin", "60.5"),
        r"--map-origin is '60.5': expected LAT,LON",
    ),
    "origin out of range": (
        ("--map", "a.geojson", "--map-origin", "95,24"),
        "latitude_deg is 95",
    ),
    "origin without map": (("--map-origin", "60,24"), "--map-origin given without --map"),
    "map": (("--map", "a.shp"), r"map \(--map\) is a.shp: expected a name in .geojson or .gpkg"),
    "udp": (("--udp", "controller"), "controller"),
    "outputs": (("--csv", "a", "--jsonl", "a"), "expected another path"),
    "twice": (("--csv", "a.csv", "--csv", "b.csv"), "--csv is given twice: expected once"),
    "record": (("--record", "images/a.jpg"), "a.jpg, which is a file of source"),
    "record all": (("--record-all",), "--record-all given without --record: expected both"),
    "port": (("--page", "--port", "70000"), "--port of the page is 70000"),
    "port alone": (("--port", "8421"), "--port given without --page: expected both"),
    "token alone": (("--token", "abc"), "--token given without --page: expected both"),
    "blank after": (("--page", "--blank-after", "0"), "--blank-after.*0.1"),
    "blank after alone": (("--blank-after", "3"), "--blank-after given without --page"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_give_one_line(
    run_cli: Cli,
    source: tuple[object, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    mistake: str,
) -> None:
    options, message = MISTAKES[mistake]
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    done = run_cli("live", *source, *options)
    assert done.code == 2
    assert done.err.count("\n") == 1, done.err
    assert re.search(message, done.err), done.err
    assert sorted(tmp_path.rglob("*")) == before


def test_sigterm_ends_it_with_everything_written(
    source: tuple[object, ...], tmp_path: Path
) -> None:
    lines = tmp_path / "lines.jsonl"
    options = ["--loop", "--page", "--port", "0", "--jsonl", str(lines)]
    command = [sys.executable, "-c", MAIN, "live", *map(str, source), *options]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    assert process.stderr is not None
    address = process.stderr.readline().removeprefix("page: ").strip()
    with urllib.request.urlopen(address, timeout=60) as answer:
        assert b"<html" in answer.read()
    with urllib.request.urlopen(f"{address}events", timeout=60) as events:
        shown = (line for line in events if line.startswith(b"data: "))
        assert len(list(itertools.islice(shown, 5))) == 5
    process.send_signal(signal.SIGTERM)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 143
    assert re.search(r"^ended: \d+ frames", said, re.MULTILINE)
    assert f"jsonl: {lines}\n" in said
    frames = [json.loads(line)["frame"] for line in lines.read_text().splitlines()]
    assert frames == list(range(len(frames)))
    assert len(frames) > 2
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


@pytest.mark.parametrize(("after", "blank"), [("0.1", True), ("60", False)])
def test_a_page_whose_results_always_come_too_late_is_told(
    run_cli: Cli,
    source: tuple[object, ...],
    monkeypatch: pytest.MonkeyPatch,
    after: str,
    blank: bool,
) -> None:
    def slow(*given: Any, **options: Any) -> Any:
        time.sleep(0.2)
        return detect(*given, **options)

    detect = TreeDetector.detect
    monkeypatch.setattr(TreeDetector, "detect", slow)
    monkeypatch.setattr(live_run, "_STATUS_EVERY_S", 0.0)
    done = run_cli("live", *source, "--frames", 2, "--page", "--port", 0, "--blank-after", after)
    assert done.code == 0, done.err
    assert ("later than --blank-after 0.1 allows" in done.err) == blank


def test_all_input_is_recorded_and_gives_the_same_trees(
    run_cli: Cli, source: tuple[object, ...], model: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    folder = tmp_path / "recordings"
    done = run_cli("live", *source, "--record", folder, "--record-all")
    assert done.code == 0, done.err
    assert f"1 recording in {folder}" in done.err
    (recording,) = folder.iterdir()
    again = run_cli("live", recording, "--model", model)
    assert again.code == 0, again.err
    assert [trees(line) for line in again.out.splitlines()] == [
        trees(line) for line in done.out.splitlines()
    ]


def trees(line: str) -> list[object]:
    return [(tree["score"], tree["box_px"], tree["metres"]) for tree in json.loads(line)["trees"]]


def wait_until(happened: Callable[[], object]) -> None:
    for _ in range(1200):
        if happened():
            return
        time.sleep(0.05)
    pytest.fail("it did not happen in a minute")


def test_how_it_goes_is_said_every_few_seconds(
    run_cli: Cli, source: tuple[object, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rosbags")
    seconds = itertools.count(0, 0.5)
    monkeypatch.setattr(time, "monotonic", lambda: float(next(seconds)))
    done = run_cli("live", *source, "--loop", "--frames", 9, "--record", tmp_path / "recordings")
    assert done.code == 0, done.err
    told = [line for line in done.err.splitlines() if line.startswith("running: ")]
    assert 1 < len(told) < 9
    assert all(line.endswith(", 0 recordings") for line in told)


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="the system has no SIGUSR1")
def test_sigusr1_marks_and_sigterm_completes_the_recording(
    run_cli: Cli, source: tuple[object, ...], model: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    folder, lines = tmp_path / "recordings", tmp_path / "lines.jsonl"
    command = [sys.executable, "-c", MAIN, "live", *map(str, source), "--loop", "--record", folder]
    with lines.open("w") as stdout:
        process = subprocess.Popen(command, stdout=stdout, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: lines.read_text().count("\n") > 1)
    process.send_signal(signal.SIGUSR1)
    wait_until(lambda: list(folder.glob("mark_*")))
    process.send_signal(signal.SIGUSR1)
    process.send_signal(signal.SIGTERM)
    told = process.communicate(timeout=60)[1]
    assert process.returncode == 143
    assert f"2 recordings in {folder}" in told
    assert len(list(folder.iterdir())) == 2
    for recording in folder.iterdir():
        assert run_cli("live", recording, "--model", model, "--frames", 2).code == 0
