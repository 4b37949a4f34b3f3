"""Commands take files and folders whose names are not UTF-8."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="names are UTF-8 on this system")

LATIN = os.fsdecode(b"caf\xe9")
SPELLED = r"caf\udce9"
MAIN = "from edgetree.cli import main; main()"


@pytest.fixture
def folder(images: Path, tmp_path: Path) -> Path:
    """A folder with an image, its depth image and the camera; all names are not UTF-8."""
    folder = tmp_path / LATIN
    for part in ("images", "depth"):
        (folder / part).mkdir(parents=True)
    (images / "a.jpg").rename(folder / "images" / f"{LATIN}.jpg")
    (tmp_path / "depth" / "a.png").rename(folder / "depth" / f"{LATIN}.png")
    (tmp_path / "camera.json").rename(folder / f"{LATIN}.json")
    return folder


def edgetree(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own, which may crash."""
    command = [sys.executable, "-c", MAIN, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_run_writes_all_its_outputs(folder: Path, model: Path) -> None:
    model = model.rename(folder / f"{LATIN}.onnx")
    out = {name: folder / f"{LATIN}.{name}" for name in ("csv", "jsonl", "coco", "html")}
    done = edgetree(
        *("run", folder / "images", "--depth", folder / "depth", "--model", model),
        *("--camera", folder / f"{LATIN}.json", "--out", folder / "out", "--csv", out["csv"]),
        *("--jsonl", out["jsonl"], "--coco", out["coco"], "--report", out["html"]),
    )
    assert done.returncode == 0, done.stderr
    assert SPELLED in done.stderr
    record = json.loads(out["jsonl"].read_text("utf-8"))
    assert os.fsencode(record["frame"]) == b"caf\xe9", "JSON gives the name back"
    assert Path(record["path"]).is_file()
    labels = json.loads(out["coco"].read_text("utf-8"))
    assert labels["images"][0]["file_name"] == f"{LATIN}.jpg"
    (row,) = csv.DictReader(out["csv"].read_text("utf-8").splitlines())
    assert row["frame"] == SPELLED
    assert SPELLED in out["html"].read_text("utf-8")
    picture = (folder / "out" / f"{LATIN}_trees.jpg").read_bytes()
    assert picture.startswith(b"\xff\xd8")


def test_run_and_measure_print_such_names(folder: Path, model: Path) -> None:
    image = folder / "images" / f"{LATIN}.jpg"
    lines = edgetree("run", image, "--model", model)
    assert lines.returncode == 0, lines.stderr
    assert json.loads(lines.stdout)["frame"] == LATIN
    depth, camera = folder / "depth" / f"{LATIN}.png", folder / f"{LATIN}.json"
    files = ("--depth", depth, "--camera", camera, "--model", model)
    done = edgetree("measure", image, *files, "--out", folder / "drawn.png", "--json")
    assert done.returncode == 0, done.stderr
    assert Path(json.loads(done.stdout)["picture"]) == folder / "drawn.png"


def test_mistakes_are_one_line(folder: Path, model: Path) -> None:
    for name, expected in (("gone.jpg", "does not exist"), ("video.avi", "its name is not UTF-8")):
        if name == "video.avi":
            (folder / name).write_bytes(b"RIFF")
        done = edgetree("run", folder / name, "--model", model)
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
        assert SPELLED in done.stderr
        assert expected in done.stderr


def test_calibrate_reads_such_pictures(folder: Path) -> None:
    board = ("--board", "checkerboard:9x6:0.025", "--out", folder / "camera.json")
    done = edgetree("calibrate", folder / "images", *board)
    assert done.returncode == 1, done.stderr
    assert "0 of 1 picture show the board" in done.stdout
