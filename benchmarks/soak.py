"""Endurance test of detection and measurement: memory, handles and latency over many frames.

python -m benchmarks.soak --frames 100000 --result benchmarks/results/soak.json \\
    --plot docs/images/soak.png

The package's samples alternate with frames without trees: blank, uniform and noise. Every mask is
pasted, and with a depth model every tree is measured. Memory, open files and threads are recorded
over the whole run, and the latency for each tenth of it. The mean of the resident memory over the
last tenth may exceed that over the second tenth, when all buffers are allocated, by a few MiB. The
exit code is 1 if it exceeds it by more, if open files or threads grew, or if a frame fails. Ctrl-C
ends the run early, with the results of the frames so far. Needs Linux, for /proc.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.errors import EdgetreeError
from benchmarks.tools.plots import endurance, save
from benchmarks.tools.processes import PROC, Usage, percentiles
from benchmarks.tools.program import finish, machine, program
from calib import PinholeCamera
from edgetree import TreeDetector, default_model, sample_frames
from edgetree.catalogue import MODALITIES
from edgetree.measure import measure_trees
from edgetree.runtime.providers import import_onnxruntime

WIDTH_PX = 1280
MOST_LOOKS = 1000
FEWEST_FRAMES = 20
PARTS = 10

Float = NDArray[np.float64]
Frame = tuple[str, NDArray[Any], PinholeCamera, Float]
"""Kind, image or depth, camera and vertical."""


def frames(modality: str, width: int) -> Iterator[Frame]:
    """Yield endlessly a sample, then a frame without trees."""
    samples: list[tuple[NDArray[Any], PinholeCamera, Float]] = []
    for sample in sample_frames():
        image: NDArray[Any] = sample.image() if modality == "rgb" else sample.depth_m()
        camera = sample.camera.scaled(width, round(width * image.shape[0] / image.shape[1]))
        small = cv2.resize(
            image, (camera.width, camera.height), interpolation=cv2.INTER_NEAREST_EXACT
        )
        samples.append((small, camera, sample.up_camera))
    rng = np.random.default_rng(0)
    shape = samples[0][0].shape
    dtype: type[Any] = np.uint8 if modality == "rgb" else np.float32
    empty: tuple[tuple[str, Callable[[], NDArray[Any]]], ...] = (
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


class Counts:
    """What was found in the frames so far."""

    def __init__(self, detector: TreeDetector) -> None:
        self._detector = detector
        self._measures = detector.manifest.modality == "depth"
        self.seen, self.trees, self.errors = Counter[str](), Counter[str](), Counter[str]()
        self.diameters = 0

    def take(self, frame: Frame) -> None:
        """Detect and measure on one frame."""
        kind, image, camera, up = frame
        try:
            found = self._detector.detect(image, camera=camera)
            for tree in range(len(found)):
                found.mask(tree)
            if self._measures:
                metres = measure_trees(found, image, camera, up_camera=up)
                self.diameters += sum(bool(tree.diameter_m) for tree in metres)
        except EdgetreeError as error:
            self.errors[f"{kind}: {error}"] += 1
        else:
            self.seen[kind] += 1
            self.trees[kind] += len(found)


def soak(detector: TreeDetector, count: int, width: int, limit_mib: float) -> dict[str, Any]:
    """Detect and measure on `count` frames, and record memory, handles and latency."""
    every = max(1, count // MOST_LOOKS)
    usage, counts = Usage(count // every + 1), Counts(detector)
    latency_ms = np.zeros(count, np.float32)
    start = time.perf_counter()
    stopped = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: stopped.set())
    done = 0
    for index, frame in zip(range(count), frames(detector.manifest.modality, width), strict=False):
        before = time.perf_counter()
        counts.take(frame)
        latency_ms[index] = (time.perf_counter() - before) * 1000
        done = index + 1
        if index % every == 0:
            usage.look(before - start)
            recent_ms = np.median(latency_ms[max(0, index - every) : done])
            sys.stderr.write(
                f"\r{index:,} of {count:,} frames, {recent_ms:.0f} ms,"
                f" {usage.resident_mib[-1]:.1f} MiB "
            )
        if stopped.is_set() and len(usage.times_s) >= FEWEST_FRAMES:
            break
    memory_mib, (handles, grown) = usage.resident_mib, usage.handles()
    tenth = len(memory_mib) // PARTS
    growth_mib = float(memory_mib[-tenth:].mean() - memory_mib[tenth : 2 * tenth].mean())
    part = np.arange(done) * PARTS // done
    return {
        "frames": done,
        "width_px": width,
        "seconds": round(time.perf_counter() - start, 1),
        "frames_by_kind": dict(counts.seen),
        "trees_by_kind": dict(counts.trees),
        "diameters": counts.diameters,
        "latency_ms": percentiles(latency_ms[:done], part, 2),
        "memory_mib": [round(float(each.mean()), 2) for each in np.array_split(memory_mib, PARTS)],
        "growth_mib": round(growth_mib, 2),
        "limit_mib": limit_mib,
        "highest_mib": round(float(memory_mib.max()), 2),
        **handles,
        "errors": dict(counts.errors),
        "passed": growth_mib <= limit_mib and not counts.errors and not grown,
    }


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw latency and memory over the run."""
    ends = (np.arange(PARTS) + 1) * result["frames"] / PARTS / 1000
    figure, top, _ = endurance(
        ends, "thousand frames", result["latency_ms"], result["memory_mib"], "frames"
    )
    top.legend()
    figure.suptitle(f"{result['model']}, {result['frames']:,} frames of {result['width_px']} px")
    save(figure, path)


def main() -> None:
    """Run the test."""
    parser = program(__doc__)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--width", type=int, default=WIDTH_PX, help="width of the frames, px")
    parser.add_argument("--model", default="depth", help="rgb, depth, or an .onnx file")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--limit-mib", type=float, default=4.0)
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    if not PROC.is_dir():
        parser.error(f"{PROC} is not there: expected Linux")
    if arguments.frames < FEWEST_FRAMES:
        parser.error(f"--frames is {arguments.frames}: expected {FEWEST_FRAMES} or more")
    cv2.setNumThreads(1)
    embedded = arguments.model in MODALITIES
    path = default_model(arguments.model) if embedded else Path(arguments.model)
    detector = TreeDetector.load(path, threads=arguments.threads, warm_up=True)
    result = {
        "machine": machine(),
        "onnxruntime": import_onnxruntime().__version__,
        "model": detector.manifest.name,
        "input_px": list(detector.manifest.input.image_shape[:2]),
        "threads_of_inference": arguments.threads,
        **soak(detector, arguments.frames, arguments.width, arguments.limit_mib),
    }
    finish(result, arguments.result)
    if arguments.plot:
        plot(result, arguments.plot)
    sys.exit(0 if result["passed"] else 1)


if __name__ == "__main__":
    main()
