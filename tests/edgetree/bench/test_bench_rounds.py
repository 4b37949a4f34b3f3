"""Variants measured in turn, in processes of their own; where the time goes; what it costs."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_python import replace_python

from basetree.errors import CheckFailed, InputError
from edgetree import TreeDetector, default_model
from edgetree.bench import worker
from edgetree.bench.peak import machine_peak
from edgetree.bench.profile import PARTS, count_multiply_adds, network_times, parts_of_nodes
from edgetree.bench.rounds import BenchSettings, Variant, measure_variants
from edgetree.bench.sensors import EnergyCounter, clock_mhz, temperature_c
from edgetree.bench.stages import STAGES
from edgetree.model_file.manifest import Manifest
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.model_file.safety_check import read_model_file
from edgetree.runtime.providers import SessionSettings

SHORT = BenchSettings(rounds=2, duration_s=0.0)


def inputs_of(path: Path) -> dict[str, Any]:
    manifest = TreeDetector.load(path).manifest
    shape = (1, *manifest.input.image_shape)
    noise = np.random.default_rng(0).integers(0, 255, shape, dtype=np.uint8)
    return {manifest.input.name: noise}


def test_the_packaged_model_is_measured_with_stages_and_cost() -> None:
    said: list[str] = []
    variants = [Variant("depth", default_model("depth"), 1, batch) for batch in (1, 2)]
    found = measure_variants(variants, SHORT, said.append)
    row, pair = found["rows"]
    assert (row["batch"], pair["batch"], row["threads"], row["runs"]) == (1, 2, 1, 10)
    assert 0 < row["p50_ms"] <= row["p90_ms"] <= row["p99_ms"]
    assert row["p50_ms"] < pair["p50_ms"]
    assert row["fps"] == pytest.approx(1000 / row["p50_ms"], rel=0.5)
    assert set(row["stages_ms"]) == set(STAGES)
    assert all(ms > 0 for ms in row["stages_ms"].values())
    assert row["file_bytes"] == default_model("depth").stat().st_size
    # The heads run on the trees of the first frame, and the manifest counts all rows.
    assert 0.7 * row["multiply_adds"] < row["graph_multiply_adds"] < row["multiply_adds"]
    assert 0 < row["share_of_peak"] < 1.5
    assert sum(row["histogram"]["counts"]) == row["runs"]
    assert row["peak_memory_mib"] > 50
    assert row["nodes"]["cpu"]["RoiAlign"] == 3
    assert found["peak"]["1"]["float32"] > 0
    assert [line for line in said if line.startswith("round")] == ["round 1 of 2", "round 2 of 2"]


# A process that measures nothing: variant a takes 20, 90 and 30 ms, and each run more memory.
WORKER = """
import json, pathlib, sys
log = pathlib.Path(__file__).with_name("asked.jsonl")
job = json.load(sys.stdin)
with log.open("a") as file:
    print(json.dumps(job), file=file)
number = len(log.read_text().splitlines())
answers = {
    "peak": {"float32": 10.0, "int8": None, "bfloat16": None},
    "detail": {"precision": "float32", "graph_multiply_adds": 10**9},
    "round": {
        "times_ms": [{4: 20.0, 6: 90.0, 8: 30.0}.get(number, 5.0)],
        "load_ms": 1.0,
        "trees_per_frame": 1.0,
        "peak_memory_mib": 10.0 + number,
        "energy_j_per_frame": None,
        "clock_mhz": None,
        "temperature_c": None,
        "provider": "cpu",
    },
}
json.dump(answers[job["task"]], sys.stdout)
"""


def test_variants_take_turns(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    replace_python(monkeypatch, tmp_path, WORKER)
    variants = [Variant(name, tmp_path / name, 1) for name in ("a", "b")]
    settings = dataclasses.replace(SHORT, rounds=3)
    found = measure_variants(variants, settings, lambda _: None)
    asked = [json.loads(line) for line in (tmp_path / "asked.jsonl").read_text().splitlines()]
    assert [job["task"] for job in asked[:3]] == ["peak", "detail", "detail"]
    rounds = [job for job in asked if job["task"] == "round"]
    assert [Path(job["model"]).name for job in rounds] == ["a", "b"] * 3
    first = found["rows"][0]
    assert first["p50_ms"] == 30.0, "the median of the rounds"
    assert first["peak_memory_mib"] == 18.0, "the highest of the rounds"
    assert [each["p50_ms"] for each in first["rounds"]] == [20.0, 90.0, 30.0]
    assert first["share_of_peak"] == pytest.approx(1e9 / 0.03 / 10e9, rel=1e-3)


def test_a_file_that_is_no_model_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "a.onnx"
    path.write_bytes(b"no model")
    with pytest.raises(InputError, match="is not an ONNX model"):
        measure_variants([Variant("a", path, 1)], SHORT, lambda _: None)


def test_a_crashed_benchmark_is_a_failed_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dying = tmp_path / "python"
    dying.write_text("#!/bin/sh\nkill -9 $$\n")
    dying.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(dying))
    with pytest.raises(CheckFailed, match=r"ended with exit code -9 \(out of memory\?\)"):
        measure_variants([Variant("a", tmp_path / "a.onnx", 1)], SHORT, lambda _: None)


@pytest.mark.parametrize("changes", [{"rounds": 0}, {"minutes": float("nan")}])
def test_invalid_settings_are_rejected(changes: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"--{next(iter(changes))} is "):
        BenchSettings(**changes)


def test_the_energy_of_the_warm_up_is_not_that_of_the_timed_frames(
    monkeypatch: pytest.MonkeyPatch, rgb_manifest: Manifest, write_model: Callable[..., Path]
) -> None:
    calls = 0
    detect = TreeDetector.detect

    def counting(detector: TreeDetector, image: Any) -> Any:
        nonlocal calls
        calls += 1
        return detect(detector, image)

    class OneJouleACall:
        def __init__(self) -> None:
            self._before = calls

        def joules(self) -> float:
            return float(calls - self._before)

    monkeypatch.setattr(TreeDetector, "detect", counting)
    monkeypatch.setattr(worker, "EnergyCounter", OneJouleACall)
    job = worker.Job("round", threads=1, model=str(write_model(rgb_manifest)), duration_s=0.0)
    assert worker._round(job)["energy_j_per_frame"] == 1.0
    assert calls == 3 + 5


def test_a_long_run_has_a_curve(rgb_manifest: Manifest, write_model: Callable[..., Path]) -> None:
    path = write_model(rgb_manifest)
    settings = dataclasses.replace(SHORT, rounds=1, minutes=1.5 / 60)
    (row,) = measure_variants([Variant("a", path, 1)], settings, lambda _: None)["rows"]
    minutes = [point["minute"] for point in row["heat"]]
    assert len(minutes) == 2
    assert minutes == sorted(minutes)
    assert all(0 < point["p50_ms"] <= point["p99_ms"] for point in row["heat"])


def test_the_parts_of_the_network_follow_each_other() -> None:
    parts = parts_of_nodes(read_model_file(default_model("rgb")).nodes)
    places = [PARTS.index(part) for part in parts.values()]
    assert parts["node_roi_align"] == parts["roi_align"] == "heads", "by node and by output"
    assert set(parts.values()) == set(PARTS)
    assert all(part == "heads" for name, part in parts.items() if "roi_align" in name)
    assert (places[0], places[-1]) == (PARTS.index("trunk"), PARTS.index("heads"))
    assert places.count(0) > 40


def test_the_profile_finds_the_expensive_operators() -> None:
    path = default_model("depth")
    found = network_times(path, SessionSettings(threads=1), [inputs_of(path)])
    assert found.operators[0].operator in ("QLinearConv", "RoiAlign")
    assert sum(found.parts_ms.values()) == pytest.approx(
        sum(each.ms for each in found.operators), rel=1e-6
    )
    assert all(found.parts_ms[part] > 0 for part in ("trunk", "pyramid", "heads"))


def test_a_matrix_product_costs_rows_times_columns_times_their_length(tmp_path: Path) -> None:
    path = tmp_path / "product.onnx"
    path.write_bytes(
        onnx_bytes(
            [Node("MatMul", ("x", "weights"), ("y",))],
            inputs={"x": TensorType("float32", (5, 8))},
            outputs={"y": TensorType("float32", (5, 3))},
            constants={"weights": np.ones((8, 3), np.float32)},
        )
    )
    assert count_multiply_adds(path, {"x": np.ones((5, 8), np.float32)}) == 5 * 8 * 3


def test_the_peak_grows_with_the_format() -> None:
    peak = machine_peak(1, 0.05)
    assert peak["float32"] is not None
    assert peak["int8"] is not None
    assert peak["float32"] > 0.1


def test_sensors_are_read_from_the_systems_files(tmp_path: Path) -> None:
    def write(name: str, text: str) -> None:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)

    write("proc/cpuinfo", "cpu MHz\t\t: 2000.5\ncpu MHz\t\t: 3000.5\n")
    assert clock_mhz(tmp_path) == 2500.5
    write("sys/devices/system/cpu/cpu0/cpufreq/scaling_cur_freq", "1800000\n")
    assert clock_mhz(tmp_path) == 1800.0
    write("sys/class/thermal/thermal_zone0/type", "x86_pkg_temp")
    write("sys/class/thermal/thermal_zone0/temp", "61000")
    write("sys/class/thermal/thermal_zone1/type", "battery")
    write("sys/class/thermal/thermal_zone1/temp", "99000")
    assert temperature_c(tmp_path) == 61.0
    write("sys/class/powercap/intel-rapl:0/energy_uj", "9000000")
    write("sys/class/powercap/intel-rapl:0/max_energy_range_uj", "10000000")
    counter = EnergyCounter(tmp_path)
    write("sys/class/powercap/intel-rapl:0/energy_uj", "2000000")
    assert counter.joules() == pytest.approx(3.0), "the counter wrapped at its range"


def test_unreadable_sensors_say_nothing(tmp_path: Path) -> None:
    assert (clock_mhz(tmp_path), temperature_c(tmp_path)) == (None, None)
    assert EnergyCounter(tmp_path).joules() is None
