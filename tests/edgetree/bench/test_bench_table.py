"""Benchmarks of several networks, and the comparison with the paper's table."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import edgetree.export
from edgetree import TreeDetector, default_model
from edgetree.bench import files as bench_files
from edgetree.bench.files import (
    NETWORKS,
    ROUNDS,
    TableSettings,
    bench_in_turn,
    cache_folder,
    find_files,
)
from edgetree.bench.paper_table import table_lines, table_record
from edgetree.bench.speed import BenchResult, model_record
from edgetree.errors import CheckFailed, InputError, ModelFileError
from edgetree.export import ExportSettings
from edgetree.model_file.manifest import (
    METADATA_KEY,
    ClassifierCost,
    Manifest,
    standard_input,
)
from edgetree.model_file.safety_check import read_model_file

NAMES = ("r50", "r101", "x101-32x4d", "x101-32x8d", "edge-n")


def bench_of(**changes: Any) -> dict[str, Any]:
    """What `edgetree bench --json` says of an untrained R50, so large that columns are full."""
    costs = {"parameters": 124_700_000, "multiply_adds": 510_400_000_000, "proposals": 1000}
    manifest = dataclasses.replace(
        Manifest.from_json(read_model_file(default_model("rgb")).metadata[METADATA_KEY]),
        input=standard_input("rgb", 800, 800),
        precision="float32",
        training_data="untrained",
        parity=None,
        classifier=ClassifierCost(25_557_032, 3_857_973_248),
        **costs,
    )
    measured = BenchResult(
        runs=5,
        threads=2,
        detect_p50_ms=12345.6,
        detect_p90_ms=13456.7,
        fps=0.08,
        trees_per_frame=2.0,
        peak_memory_mib=3210.0,
    )
    return {**model_record(manifest), "provider": "cpu", **measured.to_dict(), **changes}


def text_of(benches: dict[str, dict[str, Any]]) -> str:
    return "\n".join(table_lines(table_record(benches)))


def row_of(text: str, name: str) -> list[str]:
    return next(line.split()[1:] for line in text.splitlines() if line.startswith(f"{name} "))


def test_each_row_is_compared_with_the_paper() -> None:
    text = text_of({name: bench_of() for name in NAMES})
    counts = "25.6 {} 3.86 {} 124.7 1000 510.4 1020.8 12346 13457 0.08 {} 3210"
    assert row_of(text, "r50") == counts.format("25.6", "3.86", "18").split()
    assert row_of(text, "r101") == counts.format("44.7", "7.58", "15").split()
    assert row_of(text, "x101-32x4d") == counts.format("44.0", "7.99", "10").split()
    assert row_of(text, "edge-n") == counts.format("-", "-", "-").split()
    assert "the paper counts ResNeXt-101 32x4d; its published code and weights are 32x8d" in text
    assert "FLOPs: 2 per multiply-add" in text


def test_the_table_fits_a_terminal_of_100_columns() -> None:
    lines = text_of({name: bench_of() for name in NAMES}).splitlines()
    assert max(map(len, lines)) <= 100
    header = next(index for index, line in enumerate(lines) if line.startswith("backbone"))
    ends = [line.rstrip()[-1] for line in lines[header + 1 : header + 1 + len(NAMES)]]
    assert ends == ["0"] * len(NAMES), "no cell is wider than its column"
    assert {len(line) for line in lines[header : header + 1 + len(NAMES)]} == {len(lines[header])}


def test_untrained_files_are_marked() -> None:
    trained = bench_of(trained=True, box_ap=49.917)
    text = text_of({"r50": bench_of(), "edge-n": trained, "edge-s": bench_of()})
    assert "Untrained, for speed only: r50, edge-s." in text
    assert "edge-n: box AP 49.9" in text
    assert "X101" not in text
    assert "Untrained" not in text_of({"edge-n": trained})


def test_an_older_file_without_counts_still_has_times() -> None:
    old = bench_of(multiply_adds=None, flops=None, classifier=None, proposals=None)
    text = text_of({"r50": old})
    assert "No multiply-adds in older files; export these again: r50." in text
    assert row_of(text, "r50")[:4] == ["-", "25.6", "-", "3.86"]


def test_the_json_names_the_network_of_the_papers_counts() -> None:
    record = table_record({name: bench_of() for name in NAMES})
    assert record["schema"] == "edgetree.bench-table/1"
    rows = {row["backbone"]: row for row in json.loads(json.dumps(record))["rows"]}
    assert rows["x101-32x8d"]["paper"]["counted_network"] == "x101-32x4d"
    assert rows["r50"]["paper"]["multiply_adds"] == 3_860_000_000
    assert rows["r50"]["bench"]["flops"] == 2 * rows["r50"]["bench"]["multiply_adds"]
    assert rows["edge-n"]["paper"] is None


def test_the_cost_comes_from_the_manifest(rgb_manifest: Manifest) -> None:
    counts = {"multiply_adds": 500, "proposals": 300, "classifier": ClassifierCost(100, 40)}
    unknown = dataclasses.replace(rgb_manifest, training_data="untrained", parity=None)
    record = model_record(dataclasses.replace(unknown, **counts))
    assert (record["multiply_adds"], record["flops"]) == (500, 1000)
    assert (record["classifier"]["parameters"], record["classifier"]["flops"]) == (100, 80)
    assert (record["proposals"], record["detections"]) == (300, 20)
    assert (record["trained"], record["box_ap"]) == (False, None)
    older = model_record(dataclasses.replace(rgb_manifest, parity=None))
    assert (older["multiply_adds"], older["flops"], older["classifier"]) == (None, None, None)
    assert (older["trained"], older["box_ap"]) == (True, None)


def test_the_average_precision_comes_from_the_manifest() -> None:
    manifest = TreeDetector.load(default_model("depth")).manifest
    assert manifest.parity is not None
    record = model_record(manifest)
    assert record["trained"]
    assert 30 < record["box_ap"] < 100
    assert record["box_ap"] == manifest.parity["average_precision"]["box"]["file"]


def table_of(tmp_path: Path, *names: str, **changes: Any) -> TableSettings:
    """Settings for files of 640x384 px in `tmp_path`, with the shortest possible measurement."""
    values: dict[str, Any] = {"height": 384, "width": 640, "duration_s": 0.0, "threads": 1}
    return TableSettings(names, tmp_path, **(values | changes))


@pytest.fixture
def said() -> list[str]:
    return []


def test_existing_files_are_not_exported(
    tmp_path: Path, rgb_manifest: Manifest, write_model: Callable[..., Path], said: list[str]
) -> None:
    mine = write_model(rgb_manifest, "mine-fp32-640x384.onnx")
    settings = table_of(tmp_path, "mine")
    assert find_files(settings, said.append) == {"mine": mine}
    assert said == []


def test_missing_files_are_exported_untrained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: list[str]
) -> None:
    asked: dict[str, ExportSettings] = {}

    def export_preset(preset: str, out: Path, *, settings: ExportSettings, say: object) -> None:
        asked[preset] = settings
        out.write_bytes(b"a model")

    monkeypatch.setattr(edgetree.export, "export_preset", export_preset)
    folder = tmp_path / "new"
    settings = table_of(folder, "r50", "edge-n", precision="int8", proposals=300)
    files = find_files(settings, said.append)
    assert files["r50"] == folder / "r50-int8-640x384-300p.onnx"
    assert all(path.is_file() for path in files.values())
    assert asked["edge-n"] == ExportSettings(384, 640, proposals=300, precision="int8")
    assert "untrained" in said[0]
    asked.clear()
    find_files(settings, said.append)
    assert asked == {}


def test_files_for_different_providers_have_different_names(tmp_path: Path) -> None:
    assert table_of(tmp_path, "r50", provider="auto").path_of("r50").name == "r50-fp32-640x384.onnx"
    for_gpu = table_of(tmp_path, "r50", provider="cuda", precision="fp16")
    assert for_gpu.path_of("r50").name == "r50-fp16-640x384-cuda.onnx"


def test_an_unknown_name_is_rejected_before_any_export(tmp_path: Path, said: list[str]) -> None:
    with pytest.raises(InputError, match=r"'r5' has no file .* expected one of edge-n, edge-s"):
        find_files(table_of(tmp_path, "r50", "r5"), said.append)
    assert said == []


def test_the_networks_are_those_of_perceptree() -> None:
    pytest.importorskip("torch")
    from perceptree.models import PRESETS

    assert set(NETWORKS) == set(PRESETS)


BAD_SETTINGS = {
    "no name": ({"backbones": ("",)}, "--backbones is ''"),
    "a name twice": ({"backbones": ("r50", "r50")}, "--backbones is 'r50,r50'"),
    "a precision": ({"precision": "fp4"}, "--precision is 'fp4': expected one of fp32, fp16, int8"),
    "a provider": ({"provider": "npu"}, "--provider is 'npu': expected one of auto, cpu, cuda"),
    "a size": ({"height": 0}, "--height and --width are 0 and 800: expected 32 or more"),
}


@pytest.mark.parametrize("case", BAD_SETTINGS)
def test_invalid_settings_are_rejected(tmp_path: Path, case: str) -> None:
    changes, message = BAD_SETTINGS[case]
    with pytest.raises(InputError, match=message):
        TableSettings(**({"backbones": ("r50",), "models": tmp_path} | changes))


def test_each_file_is_measured_in_its_own_process(
    tmp_path: Path, rgb_manifest: Manifest, write_model: Callable[..., Path], said: list[str]
) -> None:
    for name in ("a", "b"):
        write_model(rgb_manifest, f"{name}-fp32-640x384.onnx")
    settings = table_of(tmp_path, "a", "b")
    records = bench_in_turn(find_files(settings, said.append), settings, said.append)
    assert [line.split(": ")[1] for line in said] == ["a", "b"] * ROUNDS
    assert records["b"]["model"] == str(tmp_path / "b-fp32-640x384.onnx")
    assert (records["a"]["rounds"], records["a"]["threads"]) == (ROUNDS, 1)
    assert records["a"]["runs"] == 5 * ROUNDS
    assert set(bench_of()) <= set(records["a"])
    assert 0 < records["a"]["detect_p50_ms"] <= records["a"]["detect_p90_ms"]
    assert records["a"]["peak_memory_mib"] > 20
    assert row_of(text_of(records), "a")[4] == "0.0"


def test_times_are_the_medians_of_the_rounds_and_memory_the_peak(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def round_of(p50_ms: float, peak: float) -> dict[str, Any]:
        measured = {"detect_p50_ms": p50_ms, "peak_memory_mib": peak, "runs": 7}
        return bench_of(input_px=[640, 384], **measured)

    rounds = iter([round_of(90.0, 10.0), round_of(20.0, 12.0), round_of(30.0, 11.0)])
    monkeypatch.setattr(bench_files, "_bench", lambda *_: next(rounds))
    settings = table_of(tmp_path, "a")
    merged = bench_in_turn({"a": tmp_path / "a.onnx"}, settings, lambda _: None)["a"]
    assert (merged["detect_p50_ms"], merged["peak_memory_mib"]) == (30.0, 12.0)
    assert merged["runs"] == 21


def test_a_file_that_contradicts_its_name_is_rejected(
    tmp_path: Path, rgb_manifest: Manifest, write_model: Callable[..., Path]
) -> None:
    small = dataclasses.replace(rgb_manifest, input=standard_input("rgb", 192, 320))
    path = write_model(small, "a-fp32-640x384.onnx")
    with pytest.raises(ModelFileError, match="takes 320x192 px in float32: expected 640x384 px"):
        bench_in_turn({"a": path}, table_of(tmp_path, "a"), lambda _: None)
    path.write_bytes(b"no model")
    with pytest.raises(InputError, match="is not an ONNX model"):
        bench_in_turn({"a": path}, table_of(tmp_path, "a"), lambda _: None)


def test_a_crashed_benchmark_is_a_failed_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dying = tmp_path / "python"
    dying.write_text("#!/bin/sh\nkill -9 $$\n")
    dying.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(dying))
    with pytest.raises(CheckFailed, match=r"ended with exit code -9 \(out of memory\?\)"):
        bench_in_turn({"a": tmp_path / "a.onnx"}, table_of(tmp_path, "a"), lambda _: None)


def test_files_are_stored_in_the_users_cache(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder().parent == tmp_path / "edgetree"
    assert cache_folder().name.startswith("models-")


def test_exporting_without_the_training_packages_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from edgetree.errors import MissingDependency
    from edgetree.export import export_preset

    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(MissingDependency, match=r'onnx is not installed: pip install "\.\[cpu,tr'):
        export_preset("edge-n", tmp_path / "model.onnx")
    assert list(tmp_path.iterdir()) == []
