"""Time to measure ten trees of a 1280x720 frame on one core.

python -m benchmarks.measure_speed --result benchmarks/results/measure_speed.json

The trees are those that the embedded depth model detects in the sample frame with the most trees,
repeated up to ten. Times are CPU times. For comparison between machines, the time to decode the
frame's 16-bit depth image in the same run is given too.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from edgetree import TreeDetections, TreeDetector, default_model, sample_frames
from edgetree.measure import measure_trees

TREES = 10
TARGET_MS = 10.0


def cpu_ms(call: Callable[[], object], rounds: int) -> float:
    """Median CPU time of a call, ms."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        call()
        times.append((time.process_time() - start) * 1000)
    return statistics.median(times)


def main() -> None:
    """Measure, print the results, and optionally write them to a file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--result", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    detector = TreeDetector.load(default_model("depth"), threads=1, score_threshold=0.3)
    found = [(detector.detect(sample.depth_m()), sample) for sample in sample_frames()]
    trees, sample = max(found, key=lambda pair: len(pair[0]))
    depth_m = sample.depth_m()
    measure_ms = {}
    for count in (1, TREES):
        some: TreeDetections = trees.select(np.arange(count) % len(trees))

        def measure(some: TreeDetections = some) -> object:
            return measure_trees(some, depth_m, sample.camera, up_camera=sample.up_camera)

        measure()
        measure_ms[str(count)] = round(cpu_ms(measure, options.rounds), 2)
    decode_ms = cpu_ms(sample.depth_m, options.rounds)
    report = {
        "frame_px": [sample.camera.width, sample.camera.height],
        "measure_ms_by_trees": measure_ms,
        "target_ms": TARGET_MS,
        "decode_depth_png_ms": round(decode_ms, 2),
        "measure_ten_per_decode": round(measure_ms[str(TREES)] / decode_ms, 3),
    }
    sys.stdout.write(json.dumps(report, indent=1) + "\n")
    if options.result is not None:
        options.result.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
