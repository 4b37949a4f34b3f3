"""The pure parts of the benchmark of other detectors: order, merging of rounds, and the table."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.contestants import NETWORKS, ours, peers
from benchmarks.peers.environments import DEVELOPMENT, packages
from benchmarks.peers.prepare import frames_file
from benchmarks.peers.rounds import merge, ratio, turns
from benchmarks.peers.table import table_lines
from edgetree import TreeDetector, default_model

PEERS = Path(__file__).resolve().parents[2] / "benchmarks" / "peers"


def record(*times_ms: float, **changes: Any) -> dict[str, Any]:
    values = {"round": 1, "times_ms": list(times_ms), "load_ms": 5.0, "first_run_ms": 9.0}
    return values | {"peak_memory_mib": 100.0} | changes


def result_row(**changes: Any) -> dict[str, Any]:
    row = {
        "name": "edge-n-int8",
        "gives": ["boxes", "masks", "keypoints"],
        "runtime": "onnxruntime 1.31.1",
        "precision": "int8",
        "licence": "Apache-2.0",
        "timed": "bare run",
        "input_px": [800, 800],
        "median_ms": 24.52,
        "ratio": 1.0,
        "peak_memory_mib": 120.4,
    }
    return row | changes


def result(*rows: dict[str, Any], **changes: Any) -> dict[str, Any]:
    values = {"reference": "edge-n-int8", "rounds": 5, "threads": 2, "machine": "Some CPU"}
    return values | {"absent": {}, "contestants": list(rows)} | changes


def test_every_contestant_runs_once_in_each_round_and_the_order_turns() -> None:
    order = list(turns(["a", "b", "c"], 3))
    assert order[:6] == [(1, "a"), (1, "b"), (1, "c"), (2, "c"), (2, "b"), (2, "a")]
    assert set(Counter(order).values()) == {1}
    assert len(order) == 9


def test_a_slow_round_does_not_move_the_median() -> None:
    slow = record(90.0, 100.0, 110.0, round=2, peak_memory_mib=300.0, load_ms=50.0)
    merged = merge([record(9.0, 10.0, 30.0), slow, record(11.0, 12.0, round=3)])
    assert merged["rounds_ms"] == {1: 10.0, 2: 100.0, 3: 11.5}
    assert merged["median_ms"] == 11.5
    assert merged["spread_ms"] == 90.0
    assert merged["runs"] == 8
    assert 100.0 <= merged["p90_ms"] <= 110.0
    assert (merged["load_ms"], merged["peak_memory_mib"]) == (5.0, 300.0)


def test_memory_is_unknown_if_one_round_does_not_tell() -> None:
    assert (
        merge([record(1.0), record(1.0, round=2, peak_memory_mib=None)])["peak_memory_mib"] is None
    )


def test_the_ratio_is_taken_within_rounds() -> None:
    reference_ms = {1: 10.0, 2: 100.0, 3: 10.0}
    assert ratio({1: 20.0, 2: 200.0, 3: 30.0}, reference_ms) == 2.0
    assert ratio({2: 300.0}, reference_ms) == 3.0


def test_the_table_names_what_each_gives_and_what_was_timed() -> None:
    whole = result_row(name="edge-n-int8, whole", timed="frame to trees", median_ms=131.4)
    other = result_row(name="rf-detr-seg-nano", input_px=[792, 792], peak_memory_mib=None)
    lines = list(table_lines(result(result_row(), whole, other, absent={"gone": "no package"})))
    assert lines[2] == (
        "| edge-n-int8 | boxes, masks, keypoints | onnxruntime 1.31.1, int8 | Apache-2.0 | 24.5"
        " | 1.00 | 120 |"
    )
    assert "| edge-n-int8, whole (frame to trees) |" in lines[3]
    assert "| 131 |" in lines[3]
    assert "(792x792 px)" in lines[4]
    assert lines[4].endswith("| – |")
    assert "gone | not measured: no package |" in lines[5]
    assert {line.count("|") for line in lines[:6]} == {8}


def test_contestants_have_names_of_their_own_and_prepared_networks(tmp_path: Path) -> None:
    manifest = TreeDetector.load(default_model("depth")).manifest
    everyone = [*ours("edge-n-int8", tmp_path / "edge-n.onnx", manifest), *peers()]
    assert len({each.name for each in everyone}) == len(everyone)
    assert {each.network for each in everyone} - {None} == set(NETWORKS)
    programs = {PEERS / "workers" / each.worker for each in everyone}
    programs |= {PEERS / "exporters" / each.exporter for each in NETWORKS.values()}
    assert [path for path in programs if not path.is_file()] == []


def test_a_file_is_timed_on_the_images_that_it_takes_and_for_the_trees_that_are_shown(
    tmp_path: Path,
) -> None:
    for modality, shape in (("rgb", (800, 800, 3)), ("depth", (800, 800))):
        manifest = TreeDetector.load(default_model(modality)).manifest
        bare, whole, openvino = ours("n", tmp_path / "n.onnx", manifest)
        assert bare.options == ("--lowest-score", "0.5")
        assert whole.options == openvino.options == ()
        frames = np.load(frames_file(bare.side_px, tmp_path, depth=bare.depth))
        assert (frames.shape[1:], frames.dtype) == (shape, np.uint8)
    metres = np.load(frames_file(whole.side_px, tmp_path, depth=whole.depth))
    assert (metres.ndim, metres.dtype) == (3, np.float32)


def test_packages_are_pinned_and_the_copyleft_peer_has_its_own_environment() -> None:
    assert [line for lines in packages().values() for line in lines if "==" not in line] == []
    homes = {each.environment for each in peers() if each.licence.startswith("AGPL")}
    assert homes - {"ultralytics", "openvino"} == set()
    assert DEVELOPMENT not in homes
