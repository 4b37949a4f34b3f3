"""A result of `edgetree bench` with made-up figures."""

from __future__ import annotations

from typing import Any

from edgetree.bench.result import make_result
from edgetree.bench.stages import STAGES


def row_of(name: str = "edge-n-depth", **changes: Any) -> dict[str, Any]:
    """What is measured of one variant, so large that columns are full."""
    times = {"p50_ms": 12345.6, "p90_ms": 13456.7, "p99_ms": 14567.8, "fps": 0.08}
    return {
        "name": name,
        "backbone": "resnet50",
        "modality": "rgb",
        "precision": "float32",
        "input_px": [800, 800],
        "provider": "cpu",
        "threads": 2,
        "batch": 1,
        "parameters": 124_700_000,
        "multiply_adds": 500_000_000_000,
        "graph_multiply_adds": 510_400_000_000,
        "proposals": 1000,
        "classifier": {"parameters": 25_557_032, "multiply_adds": 3_857_973_248},
        "trained": False,
        "file_bytes": 250_000_000,
        "load_ms": 812.3,
        **times,
        "runs": 15,
        "rounds": [{**times, "runs": 5, "clock_mhz": 2400.0, "temperature_c": None}] * 3,
        "histogram": {"edges_ms": [1.0, 2.0, 3.0], "counts": [4, 11]},
        "trees_per_frame": 2.0,
        "peak_memory_mib": 3210.0,
        "energy_j_per_frame": None,
        "giga_multiply_adds_per_s": 41.3,
        "share_of_peak": 0.42,
        "stages_ms": {stage: 1.5 + index for index, stage in enumerate(STAGES)},
        "operators": [{"operator": "Conv", "provider": "cpu", "nodes": 50, "ms": 9.0}],
        "accuracy": None,
        **changes,
    }


def result_of(rows: list[dict[str, Any]], networks: list[str | None] | None = None) -> Any:
    """A result with these rows."""
    environment = {
        "processor": "a processor",
        "usable_cores": 2,
        "onnxruntime": "1.31.1",
        "date": "2026-11-24 22:00 UTC",
    }
    method = {"rounds": 3, "duration_s": 1.0, "minutes": 0.0, "frames": "6 frames of a folder"}
    peak = {"2": {"float32": 98.7, "int8": 400.0, "bfloat16": None}}
    measured = {"peak": peak, "rows": rows}
    return make_result(measured, environment, method, networks or [None] * len(rows))


ACCURACY = {
    "source": "the model's card",
    "frames": "400 frames of the preset test, 2026-11-24",
    "box_ap": 58.34,
    "mask_ap": 53.37,
    "keypoint_ap": 76.24,
    "diameter_error_mm": 14.6,
}
