"""Speed of the simulator (frames per minute), its memory, and bytes per frame.

python -m benchmarks.simulate FOLDER --frames 1000 --result benchmarks/results/simulator.json

Memory is the sum of the proportional set sizes of all processes (Linux), sampled every second.
The folder must be new, so that nothing is resumed. Afterwards one process simulates a few scenes
under a profiler, which gives the fraction of time per stage, without the writing of files.
"""

from __future__ import annotations

import cProfile
import dataclasses
import os
import platform
import pstats
import threading
import time
from pathlib import Path

from benchmarks.tools.processes import family, memory_mib
from benchmarks.tools.program import finish, program
from perceptree.simulator import PRESETS, CameraSettings, SimulatorSettings, generate_dataset
from perceptree.simulator.dataset.frames import make_assets, simulate_frames

SAMPLE_S = 1.0
PROFILED_SCENES = 6
STAGES = {
    "scene": "describe_scene",
    "triangles": "assemble",
    "shadow map": "_draw_shadow",
    "drawing": "draw",
    "colour sensor": "expose",
    "camera faults": "apply_processing_faults",
    "precipitation": "draw_precipitation",
    "depth sensor": "measure_depth",
    "labels": "label_view",
}


class PeakMemory:
    """Records the peak memory of this process and its children until `stop`."""

    def __init__(self) -> None:
        self.mib = 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        while not self._ended.wait(SAMPLE_S):
            every = family(os.getpid())
            self.mib = max(self.mib, sum(memory_mib(pid, "smaps_rollup", "Pss") for pid in every))

    def stop(self) -> float:
        """Stop recording, and return the peak, MiB."""
        self._ended.set()
        self._thread.join()
        return self.mib


def shares_of_time(settings: SimulatorSettings, seed: int) -> dict[str, float]:
    """Fraction of the time that each of STAGES takes in one process."""
    assets = make_assets()
    list(simulate_frames(settings, seed, 1, assets))
    profiler = cProfile.Profile()
    profiler.enable()
    for scene in range(1, PROFILED_SCENES + 1):
        for _ in simulate_frames(settings, seed + scene, settings.views_per_scene, assets):
            pass
    profiler.disable()
    rows = pstats.Stats(profiler)
    whole_s = rows.total_tt  # type: ignore[attr-defined]
    spent_s = {
        key[2]: row[3]
        for key, row in rows.stats.items()  # type: ignore[attr-defined]
        if "simulator" in key[0] and key[2] in STAGES.values()
    }
    shares = {stage: round(spent_s.get(name, 0.0) / whole_s, 3) for stage, name in STAGES.items()}
    return shares | {"the rest": round(1 - sum(shares.values()), 3)}


def main() -> None:
    """Simulate and measure."""
    parser = program(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--preset", default="paper")
    parser.add_argument(
        "--size", type=int, nargs=2, default=(1280, 720), help="image width and height, px"
    )
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.out.exists():
        parser.error(f"{options.out} exists: expected a new folder")
    preset = PRESETS[options.preset]
    camera = CameraSettings.of_size(*options.size).intrinsics
    settings = dataclasses.replace(
        preset.settings, camera=dataclasses.replace(preset.settings.camera, intrinsics=camera)
    )
    memory, start_s = PeakMemory(), time.perf_counter()
    report = generate_dataset(
        options.out,
        options.frames,
        settings,
        options.seed,
        options.workers,
        files=preset.files,
    )
    duration_s = time.perf_counter() - start_s
    frames = sum(report.frames.values())
    size = {
        name: sum(f.stat().st_size for f in (options.out / name).glob("*")) / frames / 1000
        for name in ("images", "depth", "depth8", "depth_exact")
        if (options.out / name).is_dir()
    }
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
        "peak_memory_mib": round(memory.stop()),
        "kb_per_frame": {
            **{k: round(v, 1) for k, v in size.items()},
            "all": round(sum(size.values()), 1),
        },
        "trees_per_frame": round(sum(report.trees.values()) / frames, 3),
        "shares_of_time": shares_of_time(settings, options.seed),
    }
    finish(result, options.result)


if __name__ == "__main__":
    main()
