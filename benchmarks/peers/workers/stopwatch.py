"""Time a network in this process. Needs only numpy and the standard library."""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEAVY_MS = 1000.0  # networks whose first run takes so long need no more to be warm
WARM_UP_S, WARM_UP_RUNS = 0.15, 10
LEAST_RUNS = 3
LAYOUTS = ("image", "bytes", "plane", "planes")

Arrays = NDArray[Any]
Run = Callable[[Arrays], object]


def options() -> argparse.ArgumentParser:
    """The command line that all workers share."""
    parser = argparse.ArgumentParser()
    parser.add_argument("network", help="the network's file")
    parser.add_argument("frames", type=Path, help="(N, H, W, 3) uint8 BGR, .npy")
    parser.add_argument("--threads", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True, help="time to measure for")
    parser.add_argument("--layout", choices=LAYOUTS, default="bytes", help="of the input")
    return parser


def read_inputs(path: Path, layout: str) -> Arrays:
    """One input per frame along the first axis.

    Args:
        path: (N, H, W, 3) uint8 BGR, .npy.
        layout: `image` for (N, H, W, 3) uint8 BGR, `bytes` for (N, 1, H, W, 3) uint8 BGR,
            `plane` for (N, 3, H, W) float32 RGB in 0 to 1, `planes` for (N, 1, 3, H, W).
    """
    frames: Arrays = np.load(path)
    if layout in ("plane", "planes"):
        colours = frames[..., ::-1].transpose(0, 3, 1, 2)
        frames = np.ascontiguousarray(colours, dtype=np.float32) / 255
    return frames[:, None] if layout in ("bytes", "planes") else frames


def measure(load: Callable[[], Run], inputs: Arrays, duration_s: float) -> dict[str, Any]:
    """Load a network, warm it up and time it on the inputs in turn.

    Args:
        load: Loads the network and returns the call to time.
        inputs: One input per frame along the first axis, ready in memory.
        duration_s: Time to measure for; at least `LEAST_RUNS` runs are measured.
    """
    begin = time.perf_counter()
    run = load()
    loaded = time.perf_counter()
    run(inputs[0])
    first_run_ms = (time.perf_counter() - loaded) * 1000
    if first_run_ms < HEAVY_MS:
        _warm_up(run, inputs)
    times_ms: list[float] = []
    while sum(times_ms) < duration_s * 1000 or len(times_ms) < LEAST_RUNS:
        start = time.perf_counter()
        run(inputs[len(times_ms) % len(inputs)])
        times_ms.append((time.perf_counter() - start) * 1000)
    return {
        "load_ms": (loaded - begin) * 1000,
        "first_run_ms": first_run_ms,
        "times_ms": times_ms,
        "peak_memory_mib": peak_memory_mib(),
    }


def _warm_up(run: Run, inputs: Arrays) -> None:
    """Run for `WARM_UP_S` or `WARM_UP_RUNS`, whichever is less, after the first run."""
    begin = time.perf_counter()
    for index in range(WARM_UP_RUNS):
        run(inputs[index % len(inputs)])
        if time.perf_counter() - begin > WARM_UP_S:
            return


def peak_memory_mib() -> float | None:
    """Peak resident memory of this process, in MiB; None on systems without /proc."""
    status = Path("/proc/self/status")
    found = status.is_file() and re.search(r"^VmHWM:\s*(\d+) kB", status.read_text(), re.MULTILINE)
    return int(found[1]) / 1024 if found else None


def report(record: dict[str, Any]) -> None:
    """Print a record as the last line of the output, where the caller reads it."""
    sys.stdout.write("\n" + json.dumps(record) + "\n")
