"""Tests of the command line: output, files, exit codes and errors."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

import cv2
import numpy as np
import pytest
import typer
from schema_check import check_schema

import edgetree.doctor
import edgetree.runtime.session
from basetree.errors import CheckFailed
from basetree.files import current_limits
from edgetree import cli
from edgetree.commands import run_results
from edgetree.doctor import Findings, Libraries, Machine, ModelFile, ProviderResult, Speed
from edgetree.model_file.manifest import Manifest

MAIN = "from edgetree.cli import main; main()"


Cli = Callable[..., Any]


def _lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def test_run_prints_one_json_line_per_frame(run_cli: Cli, model: Path, images: Path) -> None:
    done = run_cli("run", images, "--model", model)
    assert done.code == 0, done.err
    first, second = _lines(done.out)
    assert [first["frame"], second["frame"]] == ["a", "b"]
    assert (first["image_width_px"], first["image_height_px"]) == (640, 360)
    (tree,) = first["trees"]
    assert tree["box_px"] == [100.0, 50.0, 120.0, 310.0]
    assert tree["keypoints_px"]["felling_cut"] == [110.0, 300.0, 0.9]
    assert tree["score"] == 0.9
    assert tree["mask_rle"]["size"] == [360, 640]
    assert "2 trees in 2 frames" in done.err


def test_a_limit_of_pixels_holds_for_one_command(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path
) -> None:
    large, before = tmp_path / "large.png", current_limits()
    cv2.imwrite(str(large), np.zeros((1001, 1000, 3), np.uint8))
    done = run_cli("--max-megapixels", "1", "run", large, "--model", model)
    assert done.code == 2
    assert "1000x1001 px, expected at most 1000000 pixels" in done.err
    assert current_limits() == before


def test_without_depth_the_record_asks_for_depth(run_cli: Cli, model: Path, images: Path) -> None:
    (line,) = _lines(run_cli("run", images / "a.jpg", "--model", model).out)
    assert line["trees"][0]["metres"] is None
    assert line["trees"][0]["metres_need"].startswith("need depth: pass --depth and --camera;")
    depth = images.parent / "depth" / "a.png"
    (line,) = _lines(run_cli("run", images / "a.jpg", "--model", model, "--depth", depth).out)
    assert line["trees"][0]["metres_need"] == "need the camera: pass --camera"


def test_with_depth_and_camera_each_tree_has_metres(
    run_cli: Cli, model: Path, images: Path
) -> None:
    folder = images.parent
    extra = ("--depth", folder / "depth", "--camera", folder / "camera.json")
    done = run_cli("run", images, "--model", model, "--out", folder / "out", *extra)
    assert done.code == 0, done.err
    tree = _lines(done.out)[0]["trees"][0]
    assert "metres_need" not in tree
    # The stem is 20 px wide at 4 m and f = 400 px: by tangents about 0.2 m.
    assert tree["metres"]["diameter_m"] == pytest.approx(0.2, abs=0.02)
    assert tree["metres"]["diameter_std_m"] > 0


def test_inclinations_refer_to_the_given_up_direction(
    run_cli: Cli, model: Path, images: Path
) -> None:
    folder = images.parent
    files = ("--depth", folder / "depth" / "a.png", "--camera", folder / "camera.json")
    inclinations_deg = []
    for up in ("0,-1,0", "0.5,-0.866,0"):
        done = run_cli("run", images / "a.jpg", "--model", model, *files, "--up", up)
        metres = _lines(done.out)[0]["trees"][0]["metres"]
        inclinations_deg.append(metres["inclination_deg"])
    assert inclinations_deg == pytest.approx([0, 30], abs=1.0)


def test_a_depth_model_needs_only_depth(
    run_cli: Cli, depth_manifest: Manifest, write_model: Callable[..., Path], images: Path
) -> None:
    model, depth = write_model(depth_manifest, "depth.onnx"), images.parent / "depth"
    alone = run_cli("run", depth, "--model", model, "--out", images.parent / "out")
    assert alone.code == 0, alone.err
    assert len(_lines(alone.out)) == 2
    assert (images.parent / "out" / "a_trees.jpg").exists()
    beside = run_cli("run", images, "--model", model, "--depth", depth)
    trees = [line["trees"][0]["box_px"] for line in _lines(beside.out)]
    assert trees == [line["trees"][0]["box_px"] for line in _lines(alone.out)]


def test_json_prints_one_object(run_cli: Cli, model: Path, images: Path) -> None:
    done = run_cli("run", images, "--model", model, "--json")
    record = json.loads(done.out)
    assert record["schema"] == "edgetree.run/1"
    assert record["model"]["name"] == "test-rgb"
    assert [frame["frame"] for frame in record["frames"]] == ["a", "b"]


def test_lines_and_pictures_are_written_to_the_given_paths(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path
) -> None:
    out, jsonl = tmp_path / "new" / "out", tmp_path / "trees.jsonl"
    done = run_cli("run", images, "--model", model, "--out", out, "--jsonl", jsonl)
    assert done.code == 0, done.err
    assert done.out == ""
    assert [line["frame"] for line in _lines(jsonl.read_text())] == ["a", "b"]
    assert sorted(path.name for path in out.iterdir()) == ["a_trees.jpg", "b_trees.jpg"]
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    drawn, plain = cv2.imread(str(out / "a_trees.jpg")), cv2.imread(str(images / "a.jpg"))
    assert drawn is not None
    assert plain is not None
    assert drawn.shape == plain.shape
    assert np.abs(drawn[60:300, 100:120].astype(int) - plain[60:300, 100:120]).mean() > 20
    assert f"pictures: {out}" in done.err


def test_the_next_command_is_one_that_was_not_done(
    run_cli: Cli, model: Path, images: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(images.parent)
    before = sorted(images.iterdir())
    done = run_cli("run", "images", "--model", model)
    following = _following(done.err)
    assert following[-2:] == ["--out", "images_trees"]
    assert run_cli(*following).code == 0
    done = run_cli("run", "images", "--model", model, "--out", "drawn")
    following = _following(done.err)
    assert following[-2:] == ["--report", "images_trees.html"]
    done = run_cli(*following, "--out", "drawn")
    following = _following(done.err)
    assert following[0] == "bench"
    assert run_cli(*following, "--seconds", 0, "--rounds", 1).code == 0
    assert sorted(images.iterdir()) == before


def _following(err: str) -> list[str]:
    return shlex.split(err.splitlines()[-1].removeprefix("next: edgetree "))


def test_people_at_a_terminal_get_a_short_line_for_each_frame(
    run_cli: Cli, model: Path, images: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera, depth = images.parent / "camera.json", images.parent / "depth"
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    done = run_cli("run", images, "--model", model)
    assert done.out == "a: 1 tree\nb: 1 tree\n"
    done = run_cli("run", images, "--model", model, "--depth", depth, "--camera", camera)
    for name, line in zip("ab", done.out.splitlines(), strict=True):
        assert re.fullmatch(rf"{name}: 1 tree, (no diameter|diameter .* ± .* cm)", line)
    monkeypatch.setattr("sys.stdout.isatty", lambda: False)
    assert [line["frame"] for line in _lines(run_cli("run", images, "--model", model).out)] == [
        "a",
        "b",
    ]


def test_the_score_threshold_is_applied(run_cli: Cli, model: Path, images: Path) -> None:
    done = run_cli("run", images / "a.jpg", "--model", model, "--score-threshold", 0.2)
    assert len(_lines(done.out)[0]["trees"]) == 2


def test_without_a_command_it_shows_the_help(run_cli: Cli) -> None:
    shown = run_cli()
    assert (shown.code, shown.err) == (0, "")
    assert shown.out == run_cli("--help").out
    assert "measure" in shown.out


def test_it_prints_its_version(run_cli: Cli) -> None:
    assert run_cli("--version") == (0, f"edgetree {version('edgetree')}\n", "")


def test_an_interrupt_is_one_line_and_leaves_no_files(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr(run_results, "process", interrupted)
    jsonl, out = tmp_path / "trees.jsonl", tmp_path / "out"
    done = run_cli("run", images, "--model", model, "--jsonl", jsonl, "--out", out)
    assert done == (130, "", "edgetree: interrupted\n")
    assert not jsonl.exists()
    assert not out.exists()


def test_an_interrupt_reported_by_typer_is_one_line(
    run_cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    def aborted(*_: object) -> NoReturn:
        raise typer.Abort

    monkeypatch.setattr(typer.main, "get_command", aborted)
    assert run_cli("run", "x") == (130, "", "edgetree: interrupted\n")


class _ForeignError(Exception):
    exit_code = 2


@pytest.mark.parametrize(
    ("error", "code"), [(CheckFailed("off by 3 px"), 1), (_ForeignError("off by 3 px"), 2)]
)
def test_errors_for_the_user_become_one_line(
    run_cli: Cli, images: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, code: int
) -> None:
    def fail(*_: object, **__: object) -> NoReturn:
        raise error

    monkeypatch.setattr(edgetree.TreeDetector, "load", fail)
    assert run_cli("run", images) == (code, "", "edgetree: off by 3 px\n")


def test_a_bug_shows_its_traceback(images: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> NoReturn:
        raise ZeroDivisionError

    monkeypatch.setattr(edgetree.TreeDetector, "load", fail)
    monkeypatch.setattr(sys, "argv", ["edgetree", "run", str(images)])
    with pytest.raises(ZeroDivisionError):
        cli.main()


def test_a_closed_pipe_gives_no_traceback(model: Path, images: Path) -> None:
    for number in range(40):
        (images / f"c{number}.jpg").write_bytes((images / "a.jpg").read_bytes())
    command = [sys.executable, "-c", MAIN, "run", str(images), "--model", str(model)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.read(1)
        process.stdout.close()
        errors = process.stderr.read()
    assert errors == b""


def test_help_takes_at_most_half_a_second_of_cpu_time() -> None:
    # CPU time, which does not depend on other programs on the machine.
    resource = pytest.importorskip("resource", reason="this system counts no processor time")
    times_s = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", MAIN, "--help"], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times_s.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert min(times_s) < 0.5


def test_help_imports_no_heavy_modules() -> None:
    code = "import sys, edgetree.cli; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    heavy = {"numpy", "cv2", "onnxruntime", "torch", "perceptree", "calib", "rich"}
    assert heavy & set(done.stdout.split()) == set()


HEALTHY = Findings(
    Machine("Linux x86_64", "x86_64", None, None, 4, 2, 1.5, 3.0, 8192.0, None, False),
    Libraries("3.11.7", {"numpy": "2.4.6", "onnxruntime": "1.31.1", "depthai": "3.0.0"}),
    (ProviderResult("cuda", False, "libcudnn.so.9 is not there"), ProviderResult("cpu", True)),
    Speed(2, 21.4, 39.8),
    {"V4L2": True, "FFmpeg": True, "GStreamer": False},
)
SICK = dataclasses.replace(HEALTHY, providers=(), speed=None, video={})


def test_doctor_prints_what_works(run_cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edgetree.doctor, "examine", lambda: HEALTHY)
    done = run_cli("doctor")
    assert done.code == 0
    assert "2 of 4 usable, limited to the CPU time of 1.5, 3.0 busy" in done.out
    assert "cuda does not work: libcudnn.so.9 is not there" in done.out
    assert "21 frames per second on 1 thread, 40 on 2" in done.out
    assert "OpenCV with V4L2 and FFmpeg, without GStreamer; depthai\n" in done.out
    assert "pass --threads 1" in done.out
    assert "nothing is broken" in done.out
    assert max(map(len, done.out.splitlines())) <= 100


def test_doctor_fails_if_something_is_broken(run_cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edgetree.doctor, "examine", lambda: SICK)
    done = run_cli("doctor")
    assert done.code == 1
    assert re.search(r"^broken +no provider of onnxruntime works", done.out, flags=re.MULTILINE)
    assert "nothing is broken" not in done.out
    assert "not known, as OpenCV cannot be imported" in done.out
    record = json.loads(run_cli("doctor", "--json").out)
    assert (check_schema(record), record["healthy"]) == ("edgetree.doctor/1", False)
    assert record["advice"][0]["level"] == "broken"
    assert record["machine"]["instructions"] is None


def test_doctor_runs_on_this_machine_and_says_which_models_it_has(
    run_cli: Cli, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model.rename(tmp_path / "forest.onnx")
    monkeypatch.setenv("EDGETREE_MODELS", str(tmp_path))
    done = run_cli("doctor", "--json")
    record = json.loads(done.out)
    assert {"name": "cpu", "works": True, "reason": ""} in record["providers"]
    assert record["speed"]["fps_one_thread"] > 0
    libraries = record["libraries"]
    assert {"numpy", "onnxruntime", "typer"} <= libraries["versions"].keys()
    assert record["video"]["GStreamer"] == cv2.videoio_registry.hasBackend(cv2.CAP_GSTREAMER)
    assert libraries["minima"]["numpy"]
    assert done.code == (0 if record["healthy"] else 1)
    found = {each["name"]: each for each in record["models"]}
    assert {"forest", "edge-n-rgb", "edge-n-depth", "edge-s-rgb", "edge-s-depth"} <= found.keys()
    assert found["forest"] == {
        "name": "forest",
        "path": str(tmp_path / "forest.onnx"),
        "file_sha256": hashlib.sha256((tmp_path / "forest.onnx").read_bytes()).hexdigest(),
        "version": None,
    }


def test_doctor_prints_the_models(run_cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    forest = ModelFile("forest", "/opt/forest.onnx", "0123456789abcdef", 7)
    findings = dataclasses.replace(HEALTHY, models=(forest,))
    monkeypatch.setattr(edgetree.doctor, "examine", lambda: findings)
    printed = run_cli("doctor").out
    assert "forest, version 7, SHA-256 0123456789ab, /opt/forest.onnx" in printed


def test_python_can_run_the_package() -> None:
    command = [sys.executable, "-m", "edgetree", "--help"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert done.stdout.startswith("Usage: edgetree ")
