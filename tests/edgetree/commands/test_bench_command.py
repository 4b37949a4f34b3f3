"""`edgetree bench` on the command line."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from basetree.errors import InputError
from edgetree.bench.rounds import measure_variants
from edgetree.bench.stored import read_result
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.session import OrtSession
from edgetree.sample_files import write_samples

QUICK = ("--seconds", 0, "--rounds", 1, "--threads", 1)


def test_bench_reports_this_machine(
    run_cli: Any, model: Path, images: Path, tmp_path: Path
) -> None:
    files = {name: tmp_path / f"r.{name}" for name in ("json", "csv", "md", "html")}
    written = ("--out", files["json"], "--csv", files["csv"])
    written += ("--markdown", files["md"], "--report", files["html"])
    done = run_cli("bench", model, "--frames", images, *QUICK, "--batch", "1,3", *written, "--json")
    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result == json.loads(files["json"].read_text())
    assert len(read_result(files["json"]).rows) == 2
    assert result["method"]["frames"].startswith("2 frames of ")
    assert result["environment"]["cores"] >= 1
    assert [row["batch"] for row in result["rows"]] == [1, 3]
    row = result["rows"][0]
    assert row["input_px"] == [640, 384]
    assert row["file_bytes"] == model.stat().st_size
    assert (row["parameters"], row["threads"], row["runs"]) == (1234, 1, 5)
    assert row["trees_per_frame"] == 1.0
    assert row["stages_ms"]["measure"] is None, "the frames have no depth"
    assert len(files["csv"].read_text().splitlines()) == 3
    assert files["md"].read_text().count("\n| model |") == 2
    assert "Where the time goes" in files["html"].read_text()


def test_a_disk_that_is_gone_does_not_keep_other_files_from_being_written(
    run_cli: Any, model: Path, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()

    def measure_and_pull(*arguments: Any) -> Any:
        measured = measure_variants(*arguments)
        disk.rmdir()
        return measured

    monkeypatch.setattr("edgetree.bench.rounds.measure_variants", measure_and_pull)
    gone, kept = (disk / "r.json", disk / "r.csv"), (tmp_path / "r.md", tmp_path / "r.html")
    written = ("--out", gone[0], "--csv", gone[1], "--markdown", kept[0], "--report", kept[1])
    done = run_cli("bench", model, "--frames", images, *QUICK, *written)
    assert done.code == 2
    assert f"{gone[1]} cannot be written" in done.err
    assert done.err.splitlines()[-1].startswith(f"edgetree: {gone[0]} cannot be written")
    assert all(path.stat().st_size for path in kept)


def test_bench_of_backbones_prints_the_papers_table(
    run_cli: Any, rgb_manifest: Manifest, write_model: Callable[..., Path], tmp_path: Path
) -> None:
    for name in ("r50", "edge-n"):
        write_model(rgb_manifest, f"{name}-fp32-640x384.onnx")
    arguments = ("--backbones", "r50,edge-n", "--models", tmp_path, "--size", "640x384")
    done = run_cli("bench", *arguments, *QUICK)
    assert done.code == 0, done.err
    assert re.search(r"^r50 .* 18 ", done.out, flags=re.MULTILINE)
    assert f"2 of 2 files found in {tmp_path}, used again" in done.err
    assert "{" not in done.out


def test_an_output_in_the_place_of_the_model_is_refused(run_cli: Any, model: Path) -> None:
    before = model.read_bytes()
    done = run_cli("bench", model, "--out", model, *QUICK)
    assert done.code == 2
    assert "expected another path" in done.err
    assert model.read_bytes() == before


def test_without_torch_the_packaged_files_of_a_network_are_measured(
    run_cli: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    done = run_cli("bench", "--backbones", "edge-n", "--models", tmp_path, *QUICK, "--json")
    assert done.code == 0, done.err
    assert [row["name"] for row in json.loads(done.out)["rows"]] == ["edge-n-depth", "edge-n-rgb"]
    assert "using the files that are there: onnx is not installed" in done.err
    done = run_cli("bench", "--backbones", "edge-n,r50", "--models", tmp_path, *QUICK)
    assert done.code == 2
    assert done.err.splitlines()[-1].startswith("edgetree: onnx is not installed: pip install")


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (("--threads", "1,x"), "--threads is '1,x': expected distinct whole numbers from 1 on"),
        (("--batch", "0"), "--batch is '0': expected distinct whole numbers from 1 on"),
        (("--size", "640x384"), "--size given without --backbones: expected both"),
        (("--backbones", "r50", "--size", "640"), "--size is '640': expected WIDTHxHEIGHT in px"),
        (("no-such-model",), "no model is called 'no-such-model'"),
        (("--out", "none/r.json"), "none/r.json cannot be written"),
    ],
)
def test_wrong_options_are_one_line_before_a_measurement(
    run_cli: Any, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], problem: str
) -> None:
    monkeypatch.setattr("edgetree.bench.rounds.measure_variants", None)
    done = run_cli("bench", *options)
    assert done.code == 2
    assert problem in done.err
    assert done.err.count("\n") == 1


def test_labels_are_looked_at_before_a_measurement(
    run_cli: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch")
    monkeypatch.setattr("edgetree.bench.rounds.measure_variants", None)
    done = run_cli("bench", "--data", "none")
    assert done.code == 2
    assert "none/test_RGB.json: no such file" in done.err


def test_data_that_do_not_suit_a_model_cost_no_measurement(
    run_cli: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("torch")
    monkeypatch.setattr("edgetree.bench.rounds.measure_variants", None)
    write_samples(tmp_path / "samples")
    drive = tmp_path / "samples" / "drive"
    shutil.rmtree(drive / "depth")
    done = run_cli("bench", "edge-n-depth", "--data", drive)
    assert done.code == 2
    assert "has no 8-bit depth image for it" in done.err


def test_accuracy_is_measured_with_the_provider_of_the_times(
    run_cli: Any, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Any] = []
    open_session = OrtSession.__init__

    def opening(session: OrtSession, path: Path, settings: Any = None, **others: Any) -> None:
        opened.append(settings)
        open_session(session, path, settings, **others)

    def evaluate(*arguments: Any) -> None:
        raise InputError("enough")

    monkeypatch.setattr("edgetree.evaluate.check_dataset", lambda data, split: None)
    monkeypatch.setattr("edgetree.evaluate.evaluate_file", evaluate)
    monkeypatch.setattr(OrtSession, "__init__", opening)
    done = run_cli("bench", model, "--data", "data", "--provider", "tensorrt", "--no-strict")
    assert (done.code, done.err.splitlines()[-1]) == (2, "edgetree: enough")
    frames, accuracy = opened
    assert (accuracy.provider, accuracy.strict) == (frames.provider, frames.strict)
    assert (accuracy.provider, accuracy.strict) == ("tensorrt", False)


@pytest.mark.parametrize(
    ("frames", "error_mm", "words"),
    [
        (400, 8.0, "measured on data, the diameter on 100 of its frames"),
        (100, 8.0, "measured on data"),
        (400, None, "measured on data"),
    ],
)
def test_accuracy_says_on_how_many_frames_the_diameter_is_measured(
    monkeypatch: pytest.MonkeyPatch, frames: int, error_mm: float | None, words: str
) -> None:
    from edgetree import default_model
    from edgetree.commands import bench_accuracy

    average = dict.fromkeys(("boxes", "masks", "keypoints"))
    figures = {"average_precision": average, "data": {"frames": frames}}
    report = SimpleNamespace(figures=figures)
    monkeypatch.setattr("edgetree.evaluate.evaluate_file", lambda *_: report)
    monkeypatch.setattr(bench_accuracy, "_diameter_error_mm", lambda *_: error_mm)
    found = bench_accuracy.accuracy_of(default_model("depth"), Path("data"), "test")
    assert found is not None
    assert (found["source"], found["diameter_error_mm"]) == (words, error_mm)
    assert found["frames"].startswith(f"{frames} frames, ")


def test_files_of_one_name_are_told_apart_by_their_folders(model: Path, tmp_path: Path) -> None:
    from edgetree.commands.bench import _chosen
    from edgetree.commands.bench_options import NetworkOptions

    files = [tmp_path / folder / "forest.onnx" for folder in ("v1", "v2")]
    for file in files:
        file.parent.mkdir()
        file.write_bytes(model.read_bytes())
    chosen = _chosen([*map(str, files), str(model)], NetworkOptions(), "cpu")
    assert [name for name, *_ in chosen] == ["v1/forest", "v2/forest", model.stem]


def test_accuracy_comes_from_the_card_of_the_very_file(tmp_path: Path) -> None:
    from edgetree import default_model
    from edgetree.commands.bench_accuracy import accuracy_of

    found = accuracy_of(default_model("depth"), None, "test")
    assert found is not None
    assert 40 < found["box_ap"] < 100
    assert 1 < found["diameter_error_mm"] < 60
    copy = tmp_path / "edge-n-depth.onnx"
    copy.write_bytes(default_model("depth").read_bytes() + b"\x00")
    copy.with_suffix(".json").write_bytes(default_model("depth").with_suffix(".json").read_bytes())
    assert accuracy_of(copy, None, "test") is None
