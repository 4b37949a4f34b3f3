"""Work on several workers: overhead of the engine, scaling, and memory of the driver.

python -m benchmarks.fleet_speed overhead scaling memory sizes --result FILE.json

- overhead: `edgetree run` on 1280x720 frames with depth by two processes with a shard each, and by
  Ray with two workers, in turn;
- scaling: `perceptree synth` at 640x360 and `edgetree run`, by Ray with one worker and with two, in
  turn, one thread each;
- sizes: bytes of 1280x720 frames and their results, and processor time of `edgetree run` per frame;
- memory: largest resident memory of the driver's process for few and for many tiny frames. The
  frames of the simulator are noise, as the renderer does not run in the driver.

Start-up is told apart: the rate is that of the parts after the first one of each worker, by their
times on the disk. Other load on the machine changes all of it: the result says how high it was.
Prints what it measures as JSON.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import calib
from basetree.files.writing import write_image
from basetree.jobs import open_store, read_manifests
from benchmarks.tools.processes import memory_mib
from benchmarks.tools.program import finish, note, program, read_record
from edgetree import sample_frames
from edgetree.shards.merging import Outputs, merge_frames
from edgetree.shards.work import KIND

ROOT = Path(__file__).resolve().parents[1]
FAKES = ROOT / "tests" / "support"  # a renderer of noise
MB_PER_MIB = 1.048576

Values = dict[str, Any]


@dataclass(frozen=True)
class Run:
    """One run of a command.

    Attributes:
        wall_s: Time of the whole command.
        working_s: Time from the first to the last part.
        steady_s: Time from the first part of the last worker to the last part of all.
        workers: Workers that made the parts.
        parts: Number of parts.
        largest_mb: Largest resident memory of its first process.
        working_cpu_s: Processor time of all processes from the first to the last part.
    """

    wall_s: float
    working_s: float
    parts: int
    largest_mb: float
    working_cpu_s: float
    steady_s: float
    workers: int

    @property
    def rate(self) -> float:
        """Parts per second once every worker has made one, so that start-up does not count."""
        return (self.parts - self.workers) / self.steady_s

    @property
    def cpu_s_per_part(self) -> float:
        """Processor time of a part, which other load on the machine disturbs less."""
        return self.working_cpu_s / (self.parts - 1)


def commands(
    lists: list[list[object]], parts: Path, env: dict[str, str] | None = None, workers: int = 2
) -> Run:
    """Run commands side by side to their ends, and look at the parts that they wrote."""
    start_s = time.perf_counter()
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", *map(str, words)],
            env={**(env or os.environ), "PYTHONPATH": python_path(env)},
            stdout=subprocess.DEVNULL,
        )
        for words in lists
    ]
    largest_mb, cpu = 0.0, ProcessorTime({process.pid for process in processes})
    first_cpu_s = last_cpu_s = 0.0
    seen = 0
    while any(process.poll() is None for process in processes):
        resident_mib = memory_mib(processes[0].pid, "status", "VmHWM")
        largest_mb = max(largest_mb, MB_PER_MIB * resident_mib)
        now_cpu_s, written = cpu.look(), len(list(parts.glob("*.json")))
        if written > seen:
            first_cpu_s, last_cpu_s = (first_cpu_s if seen else now_cpu_s), now_cpu_s
            seen = written
        time.sleep(0.2)
    wall_s = time.perf_counter() - start_s
    assert all(process.returncode == 0 for process in processes), lists
    times = sorted(path.stat().st_mtime for path in parts.glob("*.json"))
    cpu_s = last_cpu_s - first_cpu_s
    steady_s = times[-1] - times[workers - 1]
    return Run(wall_s, times[-1] - times[0], len(times), largest_mb, cpu_s, steady_s, workers)


class ProcessorTime:
    """Processor time of processes and all that they have started.

    Args:
        roots: Ids of the processes.
    """

    def __init__(self, roots: set[int]) -> None:
        self._known = set(roots)
        self._seconds: dict[int, float] = {}

    def look(self) -> float:
        """Seconds until now; of processes that have ended, as they were last seen."""
        fields: dict[int, list[str]] = {}
        for path in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields[int(path.parent.name)] = path.read_text().rpartition(")")[2].split()
            except OSError:
                continue
        for process in sorted(fields):
            if int(fields[process][1]) in self._known:
                self._known.add(process)
        ticks = os.sysconf("SC_CLK_TCK")
        for process in self._known & fields.keys():
            self._seconds[process] = sum(map(int, fields[process][11:13])) / ticks
        return sum(self._seconds.values())


def python_path(env: dict[str, str] | None) -> str:
    """Where processes find the packages."""
    given = (env or {}).get("PYTHONPATH")
    return str(ROOT) if given is None else given


@contextmanager
def cluster_of(cores: int, env: dict[str, str] | None = None) -> Iterator[str]:
    """A cluster of Ray on this machine; yields its address."""
    os.environ |= {"PYTHONPATH": python_path(env), "RAY_USAGE_STATS_ENABLED": "0"}
    os.environ |= env or {}
    from ray.cluster_utils import Cluster

    small = {"object_store_memory": 100 * 2**20, "include_dashboard": False}
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": cores, **small})
    try:
        yield cluster.address
    finally:
        cluster.shutdown()  # type: ignore[no-untyped-call]


def repeated_frames(folder: Path, count: int) -> tuple[Path, Path]:
    """Folders with the sample frames under many names, images and depth."""
    samples = sample_frames()
    for number in range(count):
        sample = samples[number % len(samples)]
        for name, path in (("images", sample.image_path), ("depth", sample.depth_path)):
            (folder / name).mkdir(exist_ok=True)
            (folder / name / f"{number:06d}{path.suffix}").symlink_to(path)
    return folder / "images", folder / "depth"


def tiny_frames(folder: Path, count: int) -> Path:
    """A folder with images of 64x48."""
    folder.mkdir()
    write_image(folder / "first.png", np.zeros((48, 64, 3), np.uint8))
    for number in range(1, count):
        (folder / f"{number:06d}.png").symlink_to(folder / "first.png")
    return folder


def run_command(images: Path, depth: Path, shards: Path, *options: object) -> list[object]:
    """The words of `edgetree run` with one thread."""
    camera = images.parent / "camera.json"
    if not camera.exists():
        calib.save_camera(camera, sample_frames()[0].camera)
    given = ("--depth", depth, "--camera", camera, "--threads", 1, "--shards", shards)
    return ["edgetree", "run", images, *given, *options]


def overhead(frames: int, repeats: int) -> Values:
    """The engine against two processes with a shard each."""
    runs: dict[str, list[Run]] = {"shards": [], "ray": []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        images, depth = repeated_frames(folder, frames)
        for number in range(repeats):
            for kind, found in runs.items():
                shards = folder / f"{kind}{number}"
                if kind == "shards":
                    lists = [
                        run_command(images, depth, shards, "--shard", f"{n}/2") for n in (1, 2)
                    ]
                else:
                    table = folder / f"{number}.csv"
                    lists = [run_command(images, depth, shards, "--ray", "local", "--csv", table)]
                found.append(commands(lists, shards / "parts"))
                note(kind, found[-1])
    pairs = list(zip(runs["shards"], runs["ray"], strict=True))
    return {
        "frames": frames,
        "size_px": [1280, 720],
        "runs": {kind: [asdict(run) for run in found] for kind, found in runs.items()},
        "overhead_of_time": round(statistics.median(a.rate / b.rate for a, b in pairs) - 1, 4),
        "overhead_of_processor_time": round(
            statistics.median(b.cpu_s_per_part / a.cpu_s_per_part for a, b in pairs) - 1, 4
        ),
        "start_up_s": {
            kind: round(statistics.median(r.wall_s - r.working_s for r in found), 1)
            for kind, found in runs.items()
        },
    }


def scaling(frames: int, repeats: int) -> Values:
    """One worker against two, for simulation and inference."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        images, depth = repeated_frames(folder, frames)

        def simulate(out: Path, address: str, workers: int) -> Run:
            size = ("--width", 640, "--height", 360, "--views", 2, "--preset", "plain")
            command = ["perceptree", "synth", "--out", out, "--frames", frames // 8, *size]
            return commands([[*command, "--ray", address]], out / "scenes", workers=workers)

        def infer(out: Path, address: str, workers: int) -> Run:
            command = run_command(images, depth, out, "--ray", address, "--csv", f"{out}.csv")
            return commands([command], out / "parts", workers=workers)

        return {"simulation": doubled(simulate, folder, repeats)} | {
            "inference": doubled(infer, folder, repeats)
        }


def doubled(work: Callable[[Path, str, int], Run], folder: Path, repeats: int) -> Values:
    """Rates with one worker and two, in turn."""
    runs: dict[int, list[Run]] = {1: [], 2: []}
    for number in range(repeats):
        for workers, found in runs.items():
            with cluster_of(workers) as address:
                out = folder / f"{work.__name__}{workers}_{number}"
                found.append(work(out, address, workers))
            note(work.__name__, workers, found[-1])
    ratios = [two.rate / one.rate for one, two in zip(runs[1], runs[2], strict=True)]
    return {
        "runs": {str(workers): [asdict(run) for run in found] for workers, found in runs.items()},
        "ratio": round(statistics.median(ratios), 3),
    }


def memory(few: int, many: int) -> Values:
    """Largest memory of the driver for few and many tiny frames."""
    sys.path.append(str(FAKES))
    from fake_frames import environment  # type: ignore[import-not-found]

    found: Values = {"simulation_mb": {}, "inference_mb": {}, "driver_ms_per_unit": {}}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        env = environment(folder)
        with cluster_of(2, env) as address:
            for frames in (few, many):
                size = ("--width", 128, "--height", 72, "--views", 4, "--frames", frames)
                out = folder / f"synth{frames}"
                command = ["perceptree", "synth", "--out", out, *size, "--ray", address]
                run = commands([command], out / "scenes", env)
                found["simulation_mb"][str(frames)] = round(run.largest_mb, 1)
                found["driver_ms_per_unit"][str(frames)] = round(1000 * run.cpu_s_per_part, 2)
                note("simulation", frames, run)
            for frames in (few, many):
                images, out = tiny_frames(folder / f"images{frames}", frames), folder / f"r{frames}"
                given = ("--shards", out, "--ray", address, "--csv", folder / f"{frames}.csv")
                command = ["edgetree", "run", images, *given, "--json"]
                run = commands([command], out / "parts", env)
                found["inference_mb"][str(frames)] = round(run.largest_mb, 1)
                note("inference", frames, run)
    return found


def sizes(frames: int, repeats: int) -> Values:
    """Bytes of a frame and its results, and processor time of a frame on one core."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        images, depth = repeated_frames(folder, frames)
        results = {kind: folder / f"trees.{kind}" for kind in ("jsonl", "csv", "profiles")}
        runs = []
        for number in range(repeats):
            shards = folder / f"shards{number}"
            options = [part for kind, path in results.items() for part in (f"--{kind}", path)]
            command = run_command(images, depth, shards, *options)
            runs.append(commands([command], shards / "parts"))
        merge_s = merging_s(shards, folder / "again.csv")
        bytes_of = {"image": images, "depth": depth} | results | {"parts": shards / "parts"}
        per_part = frames / runs[0].parts
        return {
            "frames": frames,
            "size_px": [1280, 720],
            "bytes_per_frame": {
                kind: round(size_of(path) / frames) for kind, path in bytes_of.items()
            },
            "trees_per_frame": round(lines_of(results["csv"]) / frames, 2),
            "merging_s_per_frame": round(merge_s / frames, 6),
            "processor_s_per_frame": round(
                statistics.median(run.cpu_s_per_part for run in runs) / per_part, 4
            ),
        }


def merging_s(shards: Path, table: Path) -> float:
    """Processor time to merge parts into JSON lines and a table."""
    start_s = time.process_time()
    outputs = Outputs(jsonl=table.with_suffix(".jsonl"), csv=table)
    merge_frames(read_manifests([open_store(shards)], (KIND,)), outputs, lines_to_stdout=False)
    return time.process_time() - start_s


def size_of(path: Path) -> int:
    """Bytes of a file, or of the files of a folder."""
    return sum(file.stat().st_size for file in ([path] if path.is_file() else path.iterdir()))


def lines_of(path: Path) -> int:
    """Number of rows of a table."""
    return len(path.read_text().splitlines()) - 1


def main() -> None:
    """Measure what is asked for, and add it to the result."""
    parser = program(__doc__)
    parser.add_argument("parts", nargs="+", choices=["overhead", "scaling", "memory", "sizes"])
    parser.add_argument("--frames", type=int, default=512)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--tiny", type=int, nargs=2, default=(1000, 10_000))
    arguments = parser.parse_args()
    result = read_record(arguments.result)
    for part in arguments.parts:
        load = os.getloadavg()[2]
        if part == "memory":
            values = memory(*arguments.tiny)
        else:
            values = {"overhead": overhead, "scaling": scaling, "sizes": sizes}[part](
                arguments.frames, arguments.repeats
            )
        result[part] = {"cores": os.cpu_count(), "load_before": round(load, 2), **values}
        finish(result, arguments.result)


if __name__ == "__main__":
    main()
