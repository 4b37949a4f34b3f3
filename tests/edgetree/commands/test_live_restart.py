"""`edgetree live` that is killed and started again keeps everything that was written."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from basetree.files.writing import remove_leftovers

Cli = Callable[..., Any]

MAIN = "from edgetree.cli import main; main()"
PATIENCE_S = 60.0

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")


@pytest.fixture
def source(images: Path, model: Path) -> tuple[object, ...]:
    """Arguments for a folder with two frames, their depth and camera."""
    depth, camera = images.parent / "depth", images.parent / "camera.json"
    return images, "--depth", depth, "--camera", camera, "--model", model


def start(*arguments: object, main: str = MAIN) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", main, "live", *map(str, arguments)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # A test runner in the background ignores the signal, which child processes inherit.
        preexec_fn=lambda: [
            signal.signal(n, signal.SIG_DFL) for n in (signal.SIGINT, signal.SIGHUP)
        ],
    )


def wait_until(happened: Callable[[], object]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < end_s, "it did not happen"
        time.sleep(0.01)


def whole_lines(path: Path) -> list[bytes]:
    content = path.read_bytes() if path.exists() else b""
    return content[: content.rfind(b"\n") + 1].splitlines(keepends=True)


def test_killed_at_random_moments_nothing_that_was_written_is_lost(
    source: tuple[object, ...], model: Path, run_cli: Cli, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    out, moment = tmp_path / "out", random.Random(0)
    out.mkdir()
    lines, table, recordings = out / "a.jsonl", out / "a.csv", out / "recordings"
    options = ("--jsonl", lines, "--csv", table, "--record", recordings, "--record-all")
    seen: list[list[bytes]] = []
    for run in range(3):
        process = start(*source, "--loop", *options)
        wait_until(lambda: len(whole_lines(lines)) > 3)
        wait_until(lambda more=run + 1: len(list(recordings.glob("*"))) == more)
        time.sleep(moment.uniform(1.1, 2.0))
        seen += [whole_lines(lines), whole_lines(table)]
        process.kill()
        process.communicate()
    done = run_cli("live", *source, *options)
    assert done.code == 0, done.err
    assert "a.jsonl was there: it is kept as a.3.jsonl" in done.err
    names = {path.name for path in out.glob("a.*")}
    assert names == {f"a.{n}{end}" for n in ("1.", "2.", "3.", "") for end in ("jsonl", "csv")}
    kept = [out / f"a.{run + 1}.{end}" for run in range(3) for end in ("jsonl", "csv")]
    for before, path in zip(seen, kept, strict=True):
        after = path.read_bytes()
        assert after.endswith(b"\n")
        assert after.startswith(b"".join(before))
    for path in kept[::2]:
        assert all(json.loads(line)["schema"] == "edgetree.live/1" for line in whole_lines(path))
    assert len(whole_lines(lines)) == 2
    unfinished = sorted(path for path in recordings.iterdir() if "unfinished" in path.name)
    assert len(unfinished) == 3
    for before, folder in zip(seen[::2], unfinished, strict=True):
        again = run_cli("live", folder, "--model", model)
        assert again.code == int("its end is missing" in again.err), again.err
        # What was written in the last second is in memory.
        assert 0 < len(again.out.splitlines()) <= len(before) + 50
    remove_leftovers(recordings)
    assert len(list(recordings.iterdir())) == 4


def test_a_map_a_report_and_a_bag_of_an_earlier_run_are_kept(
    source: tuple[object, ...], run_cli: Cli, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    out = tmp_path / "out"
    out.mkdir()
    options = [
        part
        for name in ("map", "report", "bag")
        for part in (f"--{name}", out / {"map": "a.geojson", "report": "a.html"}.get(name, name))
    ]
    first = ["a.geojson", "a.html", "bag"]
    for names in (first, ["a.1.geojson", "a.1.html", "bag.1", *first]):
        done = run_cli("live", *source, *options)
        assert done.code == 0, done.err
        assert sorted(path.name for path in out.iterdir()) == sorted(names)


def test_a_killed_run_leaves_the_map_so_far(
    source: tuple[object, ...], run_cli: Cli, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    main = f"from edgetree.sinks import maps; maps._SO_FAR_S = 0.05; {MAIN}"
    for name in ("a.geojson", "a.gpkg"):
        process = start(*source, "--loop", "--map", out / name, main=main)
        wait_until((out / f"unfinished_{name}").exists)
        process.kill()
        process.communicate()
        content = (out / f"unfinished_{name}").read_bytes()
        assert content.startswith(b"{" if name.endswith("json") else b"SQLite format 3")
        assert run_cli("live", *source, "--map", out / name).code == 0
        kept = out / f"unfinished_{name.replace('.', '.1.')}"
        assert kept.read_bytes() == content
    assert sorted(path.name for path in out.iterdir() if not path.name.startswith(".calib")) == [
        "a.geojson",
        "a.gpkg",
        "unfinished_a.1.geojson",
        "unfinished_a.1.gpkg",
    ]


def test_a_folder_that_is_no_bag_is_not_moved(
    source: tuple[object, ...], run_cli: Cli, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "letter.txt").write_text("dear")
    done = run_cli("live", *source, "--bag", mine)
    assert done.code == 2
    assert "mine or unfinished_mine exists already" in done.err
    assert (mine / "letter.txt").read_text() == "dear"


def test_two_processes_do_not_write_one_file(
    source: tuple[object, ...], run_cli: Cli, tmp_path: Path
) -> None:
    lines = tmp_path / "a.jsonl"
    process = start(*source, "--loop", "--jsonl", lines)
    wait_until(lambda: whole_lines(lines))
    done = run_cli("live", *source, "--jsonl", lines)
    assert done.code == 2
    assert "another process is writing it" in done.err
    process.terminate()
    process.communicate(timeout=PATIENCE_S)
    frames = [json.loads(line)["frame"] for line in whole_lines(lines)]
    assert frames == list(range(len(frames)))


def test_a_dropped_connection_keeps_what_sigterm_keeps(
    source: tuple[object, ...], tmp_path: Path
) -> None:
    lines, stems = tmp_path / "a.jsonl", tmp_path / "a.geojson"
    process = start(*source, "--loop", "--jsonl", lines, "--map", stems)
    wait_until(lambda: len(whole_lines(lines)) > 3)
    process.send_signal(signal.SIGHUP)
    told = process.communicate(timeout=PATIENCE_S)[1]
    assert process.returncode == 129
    assert told.splitlines()[-1] == "edgetree: interrupted"
    assert json.loads(stems.read_text())["type"] == "FeatureCollection"
    assert os.listdir(tmp_path).count("a.jsonl") == 1
