"""Endurance test of detection and measurement: memory, handles and latency over many frames.

python benchmarks/soak.py --frames 100000 --result benchmarks/results/soak.json \
    --plot docs/images/soak.png

The package's samples alternate with frames without trees: blank, uniform and noise. Every mask is
pasted, and with a depth model every tree is measured. Memory, open files and threads are recorded
over the whole run, and the latency for each tenth of it. The mean of the resident memory over the
last tenth may exceed that over the second tenth, when all buffers are allocated, by a few MiB. The
exit code is 1 if it exceeds it by more, if open files or threads grew, or if a frame fails. Ctrl-C
ends the run early, with the results of the frames so far. Needs Linux, for /proc.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.errors import EdgetreeError
from calib import PinholeCamera
from edgetree import TreeDetector, default_model, sample_frames
from edgetree.catalogue import MODALITIES
from edgetree.measure import measure_trees
from edgetree.runtime.providers import import_onnxruntime

WIDTH_PX = 1280
MOST_SAMPLES = 1000
PROCESS = Path("/proc/self")
FEWEST_FRAMES = 20
PARTS = 10

Float = NDArray[np.float64]


def rss_mib() -> float:
    """Resident memory of this process, MiB."""
    pages = int((PROCESS / "statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1024**2


def handles() -> tuple[int, int]:
    """Number of open files and of threads of this process."""
    return tuple(len(os.listdir(PROCESS / name)) for name in ("fd", "task"))


def frames(
    modality: str, width: int
) -> Iterator[tuple[str, NDArray[np.generic], PinholeCamera, Float]]:
    """Yield endlessly kind, frame, camera and vertical: a sample, then a frame without trees."""
    samples = []
    for sample in sample_frames():
        image = sample.image() if modality == "rgb" else sample.depth_m()
        camera = sample.camera.scaled(width, round(width * image.shape[0] / image.shape[1]))
        small = cv2.resize(
            image, (camera.width, camera.height), interpolation=cv2.INTER_NEAREST_EXACT
        )
        samples.append((small, camera, sample.up_camera))
    rng = np.random.default_rng(0)
    shape = samples[0][0].shape
    dtype = np.uint8 if modality == "rgb" else np.float32
    empty = (
        ("blank", lambda: np.zeros(shape, dtype)),
        ("uniform", lambda: np.full(shape, rng.integers(256) / 8, dtype)),
        ("noise", lambda: (rng.random(shape, np.float32) * 25).astype(dtype)),
    )
    turn = 0
    while True:
        image, camera, up = samples[turn % len(samples)]
        yield "sample", image, camera, up
        kind, make = empty[turn % len(empty)]
        yield kind, make(), camera, up
        turn += 1


def soak(detector: TreeDetector, count: int, width: int, limit_mib: float) -> dict[str, Any]:
    """Detect and measure on `count` frames, and record memory, handles and latency."""
    every = max(1, count // MOST_SAMPLES)
    modality = detector.manifest.modality
    memory_mib: list[float] = []
    latency_ms = np.zeros(count, np.float32)
    handles_seen: list[tuple[int, int]] = []
    seen: Counter[str] = Counter()
    trees: Counter[str] = Counter()
    measured, errors = 0, Counter[str]()
    start = time.perf_counter()
    stopped = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: stopped.set())
    stream = frames(modality, width)
    for index, (kind, frame, camera, up) in zip(range(count), stream, strict=False):
        before = time.perf_counter()
        try:
            found = detector.detect(frame)
            for tree in range(len(found)):
                found.mask(tree)
            if modality == "depth":
                metres = measure_trees(found, frame, camera, up_camera=up)
                measured += sum(bool(tree.diameter_m) for tree in metres)
        except EdgetreeError as error:
            errors[f"{kind}: {error}"] += 1
        else:
            seen[kind] += 1
            trees[kind] += len(found)
        latency_ms[index] = (time.perf_counter() - before) * 1000
        if index % every == 0:
            memory_mib.append(rss_mib())
            handles_seen.append(handles())
            show(index, count, latency_ms[max(0, index - every) : index + 1], memory_mib[-1])
        if stopped.is_set() and len(memory_mib) >= FEWEST_FRAMES:
            break
    done = index + 1
    tenth = len(memory_mib) // PARTS
    early, late = np.mean(memory_mib[tenth : 2 * tenth]), np.mean(memory_mib[-tenth:])
    files, threads = np.array(handles_seen).T
    grown = bool(files[-1] > files[tenth] or threads[-1] > threads[tenth])
    growth_mib = float(late - early)
    return {
        "frames": done,
        "width_px": width,
        "seconds": round(time.perf_counter() - start, 1),
        "frames_by_kind": dict(seen),
        "trees_by_kind": dict(trees),
        "diameters": measured,
        "latency_ms": parts_of(latency_ms[:done]),
        "memory_mib": [
            round(float(np.mean(part)), 2) for part in np.array_split(memory_mib, PARTS)
        ],
        "growth_mib": round(growth_mib, 2),
        "limit_mib": limit_mib,
        "highest_mib": round(max(memory_mib), 2),
        "open_files": [int(files[tenth]), int(files[-1]), int(files.max())],
        "threads": [int(threads[tenth]), int(threads[-1]), int(threads.max())],
        "errors": dict(errors),
        "passed": growth_mib <= limit_mib and not errors and not grown,
    }


def show(index: int, count: int, latency_ms: NDArray[np.float32], memory_mib: float) -> None:
    """Show progress on one line of the terminal."""
    sys.stderr.write(
        f"\r{index:,} of {count:,} frames, {np.median(latency_ms):.0f} ms, {memory_mib:.1f} MiB "
    )


def parts_of(latency_ms: NDArray[np.float32]) -> dict[str, list[float]]:
    """Percentiles of the latency in each tenth of the run, ms."""
    parts = np.array_split(latency_ms, PARTS)
    return {
        f"p{percent}": [round(float(np.percentile(part, percent)), 2) for part in parts]
        for percent in (50, 99)
    }


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw latency and memory over the run."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    ends = (np.arange(PARTS) + 1) * result["frames"] / PARTS / 1000
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(7, 5), sharex=True, layout="constrained")
    for name, label in (("p99", "99 % of the frames are faster"), ("p50", "median")):
        top.plot(ends, result["latency_ms"][name], marker="o", label=label)
    top.set(ylabel="latency (ms)", ylim=(0, None))
    top.legend()
    bottom.plot(ends, result["memory_mib"], marker="o", color="tab:green")
    bottom.set(
        ylabel="resident memory (MiB)",
        xlabel="thousand frames",
        ylim=(0, 1.2 * max(result["memory_mib"])),
    )
    for axes in (top, bottom):
        axes.grid(alpha=0.3)
    figure.suptitle(f"{result['model']}, {result['frames']:,} frames of {result['width_px']} px")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Print the results as JSON, and optionally write them to a file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--width", type=int, default=WIDTH_PX, help="width of the frames, px")
    parser.add_argument("--model", default="depth", help="rgb, depth, or an .onnx file")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--limit-mib", type=float, default=4.0)
    parser.add_argument("--result", type=Path)
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    if not PROCESS.is_dir():
        parser.error(f"{PROCESS} is not there: expected Linux")
    if arguments.frames < FEWEST_FRAMES:
        parser.error(f"--frames is {arguments.frames}: expected {FEWEST_FRAMES} or more")
    cv2.setNumThreads(1)
    embedded = arguments.model in MODALITIES
    path = default_model(arguments.model) if embedded else Path(arguments.model)
    detector = TreeDetector.load(path, threads=arguments.threads, warm_up=True)
    result = {
        "machine": platform.processor() or platform.machine(),
        "onnxruntime": import_onnxruntime().__version__,
        "model": detector.manifest.name,
        "input_px": list(detector.manifest.input.image_shape[:2]),
        "threads_of_inference": arguments.threads,
        **soak(detector, arguments.frames, arguments.width, arguments.limit_mib),
    }
    text = json.dumps(result, indent=2)
    sys.stdout.write(text + "\n")
    if arguments.result:
        arguments.result.write_text(text + "\n", encoding="utf-8")
    if arguments.plot:
        plot(result, arguments.plot)
    sys.exit(0 if result["passed"] else 1)


if __name__ == "__main__":
    main()
