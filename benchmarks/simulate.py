"""How fast the simulator makes frames, and what they weigh: frames a minute, memory, bytes.

python benchmarks/simulate.py FOLDER --frames 1000 --result benchmarks/results/simulator.json

Memory is the sum of the proportional set sizes of all processes (Linux), sampled every second.
The folder must be new, so that nothing is resumed.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import threading
import time
from pathlib import Path

from perceptree.simulator import PRESETS, generate_dataset

SAMPLE_S = 1.0


def family(pid: int) -> list[int]:
    """A process and all its descendants."""
    found = [pid]
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text().split():
            found += family(int(child))
    return found


def proportional_mb(pid: int) -> float:
    """Memory of one process, shared pages counted by share; 0 if it has just ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(float(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


class PeakMemory:
    """Watches this process and its children until ``stop``."""

    def __init__(self) -> None:
        self.mb = 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        while not self._ended.wait(SAMPLE_S):
            self.mb = max(self.mb, sum(proportional_mb(pid) for pid in family(os.getpid())))

    def stop(self) -> float:
        """End watching; the peak in MB."""
        self._ended.set()
        self._thread.join()
        return self.mb


def main() -> None:
    """Run, measure, print and store."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--result", type=Path)
    options = parser.parse_args()
    if options.out.exists():
        parser.error(f"{options.out} exists: expected a new folder")
    preset = PRESETS[options.preset]
    memory, start_s = PeakMemory(), time.perf_counter()
    report = generate_dataset(
        options.out, options.frames, preset.settings, options.seed, options.workers,
        files=preset.files,
    )  # fmt: skip
    duration_s = time.perf_counter() - start_s
    frames = sum(report.frames.values())
    size = {
        name: sum(f.stat().st_size for f in (options.out / name).glob("*")) / frames / 1000
        for name in ("images", "depth", "depth8", "depth_exact")
        if (options.out / name).is_dir()
    }
    camera = preset.settings.camera.intrinsics
    result = {
        "preset": options.preset,
        "frames": frames,
        "width_px": camera.width,
        "height_px": camera.height,
        "workers": options.workers,
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "duration_s": round(duration_s, 1),
        "frames_per_minute": round(60 * frames / duration_s, 1),
        "peak_memory_mb": round(memory.stop()),
        "kb_per_frame": {**{k: round(v, 1) for k, v in size.items()},
                         "all": round(sum(size.values()), 1)},
        "trees_per_frame": round(sum(report.trees.values()) / frames, 3),
    }  # fmt: skip
    sys.stdout.write(json.dumps(result, indent=1) + "\n")
    if options.result:
        options.result.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
