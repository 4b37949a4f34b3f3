"""Broken frames and interrupts: the results of the other frames are kept."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from basetree.errors import CheckFailed, InputError
from edgetree.commands import frame_results
from edgetree.commands.frame_results import LeftOut

Cli = Callable[..., Any]

MAIN = "from edgetree.cli import main; main()"


@pytest.fixture
def mixed(images: Path) -> Path:
    """The folder of images, with one that is none between the others."""
    (images / "aa.jpg").write_text("no image")
    return images


def outputs(folder: Path) -> dict[str, Path]:
    return {
        name: folder / f"trees.{name}" for name in ("jsonl", "csv", "coco", "report.html", "out")
    }


def options(files: dict[str, Path]) -> list[object]:
    return [
        part for name, path in files.items() for part in (f"--{name.removesuffix('.html')}", path)
    ]


def frames_in(files: dict[str, Path]) -> list[str]:
    """The frames in the outputs, which must be the same in all of them."""
    names = [json.loads(line)["frame"] for line in files["jsonl"].read_text().splitlines()]
    rows = csv.DictReader(files["csv"].read_text().splitlines())
    assert [row["frame"] for row in rows] == names
    labels = json.loads(files["coco"].read_text())
    assert [Path(image["file_name"]).stem for image in labels["images"]] == names
    page = files["report.html"].read_text()
    assert page.endswith("</html>\n") or page.rstrip().endswith("</html>")
    assert page.count("<figure") == len(names)
    drawn = sorted(path.name.removesuffix("_trees.jpg") for path in files["out"].iterdir())
    assert drawn == sorted(names)
    assert all(cv2.imread(str(path)) is not None for path in files["out"].iterdir())
    return names


def test_a_broken_image_is_named_and_the_others_are_kept(
    run_cli: Cli, model: Path, mixed: Path, tmp_path: Path
) -> None:
    files = outputs(tmp_path)
    done = run_cli("run", mixed, "--model", model, *options(files))
    assert done.code == 1
    assert frames_in(files) == ["a", "b"]
    lines = done.err.splitlines()
    assert lines[0].startswith(f"left out: image {mixed / 'aa.jpg'} cannot be read (8 bytes)")
    assert "2 trees in 2 frames" in lines[1]
    assert lines[-1] == "edgetree: 1 of 3 frames left out, see above"
    page = files["report.html"].read_text()
    assert f"<h2>1 frame left out</h2><ul><li>image {mixed / 'aa.jpg'} cannot be read" in page


def test_bench_measures_the_other_frames(run_cli: Cli, model: Path, mixed: Path) -> None:
    done = run_cli("bench", model, "--frames", mixed, *("--seconds", 0, "--rounds", 1, "--json"))
    assert done.code == 1
    assert json.loads(done.out)["method"]["frames"].startswith("2 frames")
    lines = done.err.splitlines()
    assert lines[0].startswith(f"left out: image {mixed / 'aa.jpg'} cannot be read (8 bytes)")
    assert lines[-1] == "edgetree: 1 of 3 frames left out, see above"


def test_frames_with_the_same_reason_are_counted_each(capsys: pytest.CaptureFixture[str]) -> None:
    left_out = LeftOut(strict=False)
    for _ in range(5):
        left_out.add(ValueError("the same"))
    assert capsys.readouterr().err.count("left out: the same") == 1
    with pytest.raises(CheckFailed, match="5 of 8 frames left out"):
        left_out.check_none(3)
    with pytest.raises(InputError, match="all 5 frames left out"):
        left_out.check_some(0)
    with pytest.raises(InputError, match="there is no frame"):
        LeftOut(strict=False).check_some(0)


def test_the_report_counts_the_frames_with_the_same_reason(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path
) -> None:
    video = tmp_path / "square.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 10, (480, 480))
    for _ in range(3):
        writer.write(np.zeros((480, 480, 3), np.uint8))
    writer.release()
    page = tmp_path / "r.html"
    rig = ("--camera", images.parent / "camera.json", "--camera-height", 1.5)
    done = run_cli("run", images / "a.jpg", video, "--model", model, *rig, "--report", page)
    assert done.code == 1
    assert done.err.splitlines()[-1] == "edgetree: 3 of 4 frames left out, see above"
    text = page.read_text()
    assert "<h2>3 frames left out</h2>" in text
    assert text.count("the camera is for 640x360 px and the image is 480x480") == 1


def test_a_frame_that_does_not_fit_the_camera_is_left_out(
    run_cli: Cli, model: Path, images: Path
) -> None:
    cv2.imwrite(str(images / "b.jpg"), np.zeros((480, 640, 3), np.uint8))
    cv2.imwrite(str(images.parent / "depth" / "b.png"), np.full((480, 640), 4000, np.uint16))
    rig = ("--depth", images.parent / "depth", "--camera", images.parent / "camera.json")
    done = run_cli("run", images, "--model", model, *rig, "--json")
    assert done.code == 1
    record = json.loads(done.out)
    assert [frame["frame"] for frame in record["frames"]] == ["a"]
    (reason,) = record["left_out"]
    assert "b.jpg: the camera is for 640x360 px and the image is 640x480" in reason


def test_strict_frames_stops_at_the_first(
    run_cli: Cli, model: Path, mixed: Path, tmp_path: Path
) -> None:
    files = outputs(tmp_path)
    done = run_cli("run", mixed, "--model", model, *options(files), "--strict-frames")
    assert done.code == 2
    assert done.err.startswith(f"edgetree: image {mixed / 'aa.jpg'} cannot be read (8 bytes)")
    assert not any(path.is_file() for path in files.values())


def test_a_folder_without_a_usable_frame_writes_nothing(
    run_cli: Cli, model: Path, mixed: Path, tmp_path: Path
) -> None:
    for name in ("a.jpg", "b.jpg"):
        (mixed / name).unlink()
    files = outputs(tmp_path)
    done = run_cli("run", mixed, "--model", model, *options(files))
    assert done.code == 2
    assert done.err.splitlines()[-1].startswith("edgetree: all 1 frame left out: expected")
    assert not any(path.exists() for path in files.values())


def test_an_interrupt_keeps_the_frames_before_it(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = frame_results.readable

    def interrupted(*arguments: Any) -> Any:
        frames = found(*arguments)
        yield next(frames)
        raise KeyboardInterrupt

    monkeypatch.setattr(frame_results, "readable", interrupted)
    files = outputs(tmp_path)
    done = run_cli("run", images, "--model", model, *options(files), "--json")
    assert done.code == 130
    assert frames_in(files) == ["a"]
    record = json.loads(done.out)
    assert record["interrupted"] is True
    assert len(record["frames"]) == 1
    assert done.err.splitlines()[-1] == "edgetree: interrupted"
    assert f"table: {files['csv']}" in done.err


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals to send")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_keeps_whole_frames_in_all_outputs(
    model: Path, images: Path, tmp_path: Path, number: signal.Signals, code: int
) -> None:
    for copy in range(200):
        (images / f"c{copy}.jpg").write_bytes((images / "a.jpg").read_bytes())
    files = outputs(tmp_path)
    command = [sys.executable, "-c", MAIN, "run", images, "--model", model, *options(files)]
    process = subprocess.Popen(
        [*map(str, command)],
        stderr=subprocess.PIPE,
        text=True,
        # A test runner in the background ignores the signal, which child processes inherit.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    out = files["out"]
    while process.poll() is None and not (out.is_dir() and len(list(out.glob("*.jpg"))) > 3):
        time.sleep(0.01)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == code
    assert errors.splitlines()[-1] == "edgetree: interrupted"
    assert 3 < len(frames_in(files)) < 202
    assert not list(tmp_path.glob(".*"))
    assert not list(out.glob(".*"))
