"""Endurance test of a detector: memory must not grow over many frames, and no frame may fail.

python benchmarks/soak.py --result benchmarks/results/soak.json

The package's samples alternate with frames without trees: blank, uniform and noise. Resident memory
is recorded over the whole run. Its mean over the last tenth of the run may exceed that over the
second tenth, when all buffers are allocated, by a few MiB. The exit code is 1 if it exceeds it by
more, or if a frame fails. Needs Linux, for /proc.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edgetree import EdgetreeError, TreeDetector, default_model, sample_frames
from edgetree.runtime.detector import MODALITIES
from edgetree.runtime.providers import import_onnxruntime

HEIGHT_PX, WIDTH_PX = 720, 1280
MOST_SAMPLES = 1000
STATM = Path("/proc/self/statm")
FEWEST_FRAMES = 20


def rss_mib() -> float:
    """Resident memory of this process, MiB."""
    pages = int(STATM.read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1024**2


def frames(modality: str) -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Yield endlessly kind and frame: alternately a sample and a frame without trees."""
    samples = [frame.image() if modality == "rgb" else frame.depth_m() for frame in sample_frames()]
    rng = np.random.default_rng(0)
    shape = (HEIGHT_PX, WIDTH_PX, 3) if modality == "rgb" else (HEIGHT_PX, WIDTH_PX)
    empty = (
        ("blank", lambda: np.zeros(shape, np.uint8)),
        ("uniform", lambda: np.full(shape, rng.integers(256), np.uint8)),
        ("noise", lambda: rng.integers(0, 256, shape, np.uint8)),
    )
    turn = 0
    while True:
        yield "sample", samples[turn % len(samples)]
        kind, make = empty[turn % len(empty)]
        yield kind, make()
        turn += 1


def soak(detector: TreeDetector, count: int, limit_mib: float) -> dict[str, object]:
    """Detect on `count` frames, paste every mask, and record the memory."""
    every = max(1, count // MOST_SAMPLES)
    memory_mib: list[float] = []
    seen: dict[str, int] = {}
    trees: dict[str, int] = {}
    errors: list[str] = []
    start = time.perf_counter()
    for index, (kind, frame) in zip(range(count), frames(detector.manifest.modality), strict=False):
        try:
            found = detector.detect(frame)
            for tree in range(len(found)):
                found.mask(tree)
        except EdgetreeError as error:
            errors.append(f"frame {index} ({kind}): {error}")
        else:
            seen[kind] = seen.get(kind, 0) + 1
            trees[kind] = trees.get(kind, 0) + len(found)
        if index % every == 0:
            memory_mib.append(rss_mib())
    tenth = len(memory_mib) // 10
    early, late = np.mean(memory_mib[tenth : 2 * tenth]), np.mean(memory_mib[-tenth:])
    growth_mib = float(late - early)
    return {
        "frames": count,
        "seconds": round(time.perf_counter() - start, 1),
        "frames_by_kind": seen,
        "trees_by_kind": trees,
        "second_tenth_mib": round(float(early), 2),
        "last_tenth_mib": round(float(late), 2),
        "growth_mib": round(growth_mib, 2),
        "limit_mib": limit_mib,
        "highest_mib": round(max(memory_mib), 2),
        "errors": errors[:20],
        "failed_frames": len(errors),
        "passed": growth_mib <= limit_mib and not errors,
    }


def main() -> None:
    """Print the results as JSON, and optionally write them to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--model", default="rgb", help="rgb, depth, or an .onnx file")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--limit-mib", type=float, default=4.0)
    parser.add_argument("--result", type=Path)
    arguments = parser.parse_args()
    if not STATM.is_file():
        parser.error(f"{STATM} is not there: expected Linux")
    if arguments.frames < FEWEST_FRAMES:
        parser.error(f"--frames is {arguments.frames}: expected {FEWEST_FRAMES} or more")
    embedded = arguments.model in MODALITIES
    path = default_model(arguments.model) if embedded else Path(arguments.model)
    detector = TreeDetector.load(path, threads=arguments.threads, warm_up=True)
    result = {
        "machine": platform.processor() or platform.machine(),
        "onnxruntime": import_onnxruntime().__version__,
        "model": detector.manifest.name,
        **soak(detector, arguments.frames, arguments.limit_mib),
    }
    text = json.dumps(result, indent=2)
    sys.stdout.write(text + "\n")
    if arguments.result:
        arguments.result.write_text(text + "\n", encoding="utf-8")
    sys.exit(0 if result["passed"] else 1)


if __name__ == "__main__":
    main()
