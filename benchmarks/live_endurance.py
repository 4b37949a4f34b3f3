"""An hour of the live pipeline on a drive, with a camera process that is killed on the way.

python -m benchmarks.live_endurance DRIVE --result benchmarks/results/live_endurance.json \
    --plot docs/images/live_endurance.png

A process of its own plays the camera: it reads the frames of a simulated drive and sends them at a
fixed rate, to the end of the drive and back again, as long as the run lasts. It is killed at equal
intervals (SIGKILL), and the pipeline opens it again. Recorded are the latency from a frame's
arrival to its published result, memory, open files and threads, the frames that are missing, and
which number each labelled stem has whenever it is seen. The exit code is 1 if memory, files or
threads grew. Ctrl-C ends the run early, with its results. Needs Linux, for /proc.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.tools.drives import drive_records, frame_without_pixels
from benchmarks.tools.plots import endurance, save
from benchmarks.tools.processes import Usage, percentiles
from benchmarks.tools.program import finish, machine, program
from calib import read_depth
from edgetree import TreeDetector, default_model
from edgetree.frames.frame import Frame
from edgetree.frames.images import read_image
from edgetree.live import LivePipeline
from edgetree.live.results import LiveResult
from edgetree.live.tracking import TreeTrack
from edgetree.measure import Estimate
from edgetree.runtime.providers import import_onnxruntime
from edgetree.sinks import JsonLinesSink
from edgetree.sources.source import BaseSource, FrameSource, SourceLost

MEMORY_LIMIT_MIB = 8.0
SAME_STEM_M = 0.5


def there_and_back(count: int, number: int) -> int:
    """Index of a frame of the drive, played forwards and backwards in turn."""
    turn = number % (2 * count - 2)
    return turn if turn < count else 2 * count - 2 - turn


def play(folder: Path, count: int, rate_hz: float, start_s: float, to: Connection) -> None:
    """The process of the camera: send each frame at its time, and skip those whose time is over."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    images = [record["image"] for record in records_of(folder, count)]
    while True:
        number = max(0, int((time.monotonic() - start_s) * rate_hz) + 1)
        time.sleep(max(0.0, start_s + number / rate_hz - time.monotonic()))
        image = images[there_and_back(count, number)]
        frame = replace(
            frame_without_pixels(image),
            number=number,
            time_s=number / rate_hz,
            image=read_image(folder / image["file_name"]),
            depth_m=read_depth(folder / image["depth_file"]),
        )
        to.send(frame)


class CameraProcess(BaseSource):
    """A live source of the frames that the camera's process sends."""

    is_live = True

    def __init__(self, folder: Path, count: int, rate_hz: float, start_s: float) -> None:
        super().__init__("camera process")
        context = multiprocessing.get_context("spawn")
        self._from, to = context.Pipe(duplex=False)
        arguments = (folder, count, rate_hz, start_s, to)
        self._process = context.Process(target=play, args=arguments, daemon=True)
        self._process.start()
        to.close()

    def __iter__(self) -> Iterator[Frame]:
        with self._from:
            while not self._is_closed.is_set():
                try:
                    frame = self._from.recv()
                except (EOFError, OSError) as error:
                    if self._is_closed.is_set():
                        return
                    raise SourceLost(f"{self.name} does not answer") from error
                yield frame

    def kill(self) -> None:
        """End the process at once, as a fault would."""
        os.kill(self._process.pid or 0, signal.SIGKILL)

    def close(self) -> None:
        """End the process."""
        if not self._is_closed.is_set():
            super().close()
            self._process.kill()
            self._process.join()
            self._process.close()


class Identities:
    """Which number each labelled stem has whenever it is seen.

    A followed stem that is seen is taken for the labelled one of the frame at its place. (By their
    boxes, two stems of which one hides the other would often be taken for each other.)
    """

    def __init__(self, labels: list[list[dict[str, Any]]], part_s: float, parts: int) -> None:
        self._labels = labels
        self._part_s, self._parts = part_s, parts
        self._last: dict[int, int] = {}
        self._seen: list[Counter[int]] = [Counter() for _ in range(parts)]
        self._switches = Counter[int]()
        self._error_sums: list[dict[int, float]] = [defaultdict(float) for _ in range(parts)]
        self._error_counts: list[Counter[int]] = [Counter() for _ in range(parts)]
        self._numbers: dict[int, set[int]] = defaultdict(set)

    def add(self, result: LiveResult) -> None:
        """Take one result."""
        assert result.frame.number is not None
        labels = self._labels[there_and_back(len(self._labels), result.frame.number)]
        tracks = [t for t in result.tracks if t.state == "confirmed" and t.tree is not None]
        if not (labels and tracks):
            return
        part = min(int(result.frame.stamp_s / self._part_s), self._parts - 1)
        places_m = np.array([track.position_m.xyz_m[:2] for track in tracks])
        for label in labels:
            away_m = np.linalg.norm(places_m - label["position_world_m"][:2], axis=1)
            nearest = int(away_m.argmin())
            if away_m[nearest] < SAME_STEM_M:
                self._count(part, label, tracks[nearest])

    def _count(self, part: int, label: dict[str, Any], track: TreeTrack) -> None:
        """Take a sighting of a labelled stem."""
        stem = label["stem"]
        self._switches[part] += self._last.get(stem, track.number) != track.number
        self._last[stem] = track.number
        self._numbers[stem].add(track.number)
        self._seen[part][stem] += 1
        if isinstance(track.diameter_m, Estimate):
            self._error_sums[part][stem] += track.diameter_m.value - label["diameter_m"]
            self._error_counts[part][stem] += 1

    def summary(self) -> dict[str, Any]:
        """Numbers and errors, by part of the run."""
        kept = [part for part in range(self._parts) if self._seen[part]]
        return {
            "stems_seen": [len(self._seen[part]) for part in kept],
            "sightings": [sum(self._seen[part].values()) for part in kept],
            "switches": [self._switches[part] for part in kept],
            "numbers_per_stem": round(float(np.mean([len(n) for n in self._numbers.values()])), 3),
            "median_abs_error_m": [self._median_abs_error_m(part) for part in kept],
        }

    def _median_abs_error_m(self, part: int) -> float:
        """Median over the stems of the size of their mean error."""
        counts = self._error_counts[part]
        means = [abs(total / counts[stem]) for stem, total in self._error_sums[part].items()]
        return round(float(np.median(means)), 4)


def records_of(folder: Path, count: int) -> list[dict[str, Any]]:
    """Image and labels of the first frames of a drive."""
    (scene,) = sorted((folder / "scenes").glob("*.json"))
    return drive_records(scene)[:count]


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Follow the drive for the given time."""
    duration_s, rate_hz = arguments.minutes * 60.0, arguments.rate
    records = records_of(arguments.drive, arguments.frames)
    labels = [record["annotations"] for record in records]
    detector = TreeDetector.load(default_model("depth"), threads=arguments.threads, warm_up=True)
    start_s = time.monotonic()
    cameras: list[CameraProcess] = []

    def open_camera() -> FrameSource:
        cameras.append(CameraProcess(arguments.drive, len(labels), rate_hz, start_s))
        return cameras[-1]

    pipeline = LivePipeline(open_camera, detector)
    part_s = duration_s / arguments.parts
    identities = Identities(labels, part_s, arguments.parts)
    # Written in full before the run, so that it takes no more memory as it goes on.
    most = round(duration_s * rate_hz * 1.1) + 100
    rows = np.full((most, 3), np.nan)  # time in s, latency in ms, number of the frame
    usage = Usage(round(duration_s) + 100)
    count = 0
    kills_s = [duration_s * (k + 1) / (arguments.kills + 1) for k in range(arguments.kills)]
    killed: list[tuple[float, int]] = []
    signal.signal(signal.SIGINT, lambda *_: pipeline.stop())
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        sink = JsonLinesSink(nowhere)
        for result in pipeline:
            before_s = time.monotonic()
            sink.write(result)
            now_s = time.monotonic()
            assert result.frame.number is not None
            age_ms = (result.age_s + now_s - before_s) * 1000
            rows[count] = now_s - start_s, age_ms, result.frame.number
            count += 1
            identities.add(result)
            if not len(usage.times_s) or now_s - start_s - usage.times_s[-1] >= 1.0:
                usage.look(now_s - start_s)
                show(now_s - start_s, duration_s, pipeline)
            if len(killed) < len(kills_s) and now_s - start_s >= kills_s[len(killed)]:
                killed.append((now_s - start_s, result.frame.number))
                cameras[-1].kill()
            if now_s - start_s >= duration_s or count == most:
                break
    status = pipeline.status
    return {
        "machine": machine(),
        "onnxruntime": import_onnxruntime().__version__,
        "threads_of_inference": arguments.threads,
        "seconds": round(float(usage.times_s[-1]), 1),
        "rate_hz": rate_hz,
        "frames_of_drive": len(labels),
        "results": status.results,
        "dropped_for_newer": status.dropped,
        "left_out": status.left_out,
        "camera_killed_s": [round(at_s, 1) for at_s, _ in killed],
        "camera_lost": status.lost,
        **missing(rows[:count, 2].astype(int), [number for _, number in killed]),
        **over_time(rows[:count], usage, part_s, arguments.parts),
        "identities": identities.summary(),
    }


def missing(seen: NDArray[np.int_], killed_at: list[int]) -> dict[str, Any]:
    """Frames that have no result: between a kill and the first frame after it, and otherwise."""
    steps = np.diff(seen) - 1
    after = []
    for number in killed_at:
        # Up to a few frames were on their way when the camera was killed.
        near = (seen[:-1] >= number) & (seen[:-1] <= number + 5)
        after.append(int(steps[near].max(initial=0)))
    return {"missing_after_kill": after, "missing_else": int(steps.sum()) - sum(after)}


def over_time(rows: NDArray[np.float64], usage: Usage, part_s: float, parts: int) -> dict[str, Any]:
    """Latency and memory in each part of the run, open files and threads, and whether they grew."""

    def part_of(times_s: NDArray[np.float64]) -> NDArray[np.int_]:
        return np.minimum(times_s // part_s, parts - 1).astype(int)

    looked = part_of(usage.times_s)
    memory_mib = [float(usage.resident_mib[looked == part].mean()) for part in np.unique(looked)]
    growth_mib = memory_mib[-1] - memory_mib[len(memory_mib) // 10]
    handles, grown = usage.handles()
    return {
        "latency_ms": percentiles(rows[:, 1], part_of(rows[:, 0]), 1),
        "memory_mib": [round(value, 2) for value in memory_mib],
        "growth_mib": round(growth_mib, 2),
        "limit_mib": MEMORY_LIMIT_MIB,
        **handles,
        "passed": growth_mib <= MEMORY_LIMIT_MIB and not grown,
    }


def show(now_s: float, duration_s: float, pipeline: LivePipeline) -> None:
    """Show progress on one line of the terminal."""
    sys.stderr.write(f"\r{now_s:,.0f} of {duration_s:,.0f} s, {pipeline.status.line()[:100]} ")


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw latency and memory over the run."""
    count = len(result["memory_mib"])
    ends = (np.arange(count) + 0.5) * result["seconds"] / 60 / count
    figure, top, bottom = endurance(
        ends, "minutes", result["latency_ms"], result["memory_mib"], "results"
    )
    frame_ms = 1000 / result["rate_hz"]
    top.axhline(2 * frame_ms, color="grey", linestyle=":", label="two frame times")
    for axes in (top, bottom):
        for number, at_s in enumerate(result["camera_killed_s"]):
            label = "camera killed" if number == 0 else ""
            axes.axvline(at_s / 60, color="tab:red", linewidth=0.8, alpha=0.6, label=label)
    top.legend(fontsize="small", ncols=2, loc="upper center")
    figure.suptitle(f"{result['results']:,} frames of a drive at {result['rate_hz']:g} per second")
    save(figure, path)


def main() -> None:
    """Run the test."""
    parser = program(__doc__)
    parser.add_argument("drive", type=Path, help="dataset of the preset drive, with one scene")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=15.0, help="frames per second")
    parser.add_argument("--frames", type=int, default=400, help="frames of the drive to use")
    parser.add_argument("--kills", type=int, default=10, help="how often the camera is killed")
    parser.add_argument("--parts", type=int, default=60, help="parts of the run in the result")
    parser.add_argument("--threads", type=int, default=2, help="threads of an inference")
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    result = run(arguments)
    finish(result, arguments.result)
    if arguments.plot:
        plot(result, arguments.plot)
    sys.exit(0 if result["passed"] else 1)


if __name__ == "__main__":
    main()
