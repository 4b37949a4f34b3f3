"""A process that measures one model file: python -m edgetree.bench.worker.

It reads one `Job` as JSON from standard input and writes one JSON object to standard output. Each
measurement has a process of its own, so that memory is that of one model, and differences between
processes (where their memory lies) become part of the spread.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from basetree.errors import EdgetreeError
from basetree.files.regular import read_regular
from edgetree.bench.frames import BenchFrame, bench_frames
from edgetree.bench.peak import machine_peak
from edgetree.bench.profile import count_multiply_adds, network_times
from edgetree.bench.sensors import EnergyCounter, sensor_values
from edgetree.bench.speed import call_times_ms, model_record, peak_memory_mib
from edgetree.bench.stages import stages_ms
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.providers import SessionSettings
from edgetree.runtime.session import OrtSession

_HEAT_POINTS: Final = 60
_SHORTEST_POINT_S: Final = 1.0

Record = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """What to measure.

    Attributes:
        task: `round` for times, `detail` for cost and stages, `heat` for a long run, `peak` for the
            machine's products, which need no model.
        threads: Threads of one inference.
        model: The model file.
        provider: As for `TreeDetector.load`.
        strict: likewise.
        require_signature: likewise.
        source: Frames as for `bench_frames`.
        batch: Frames that are handed over together.
        duration_s: Time to measure for.
    """

    task: Literal["round", "detail", "heat", "peak"]
    threads: int
    model: str = ""
    provider: str = "cpu"
    strict: bool = True
    require_signature: bool = False
    source: str | None = None
    batch: int = 1
    duration_s: float = 1.0

    @property
    def session(self) -> SessionSettings:
        """The settings of the job's sessions."""
        return SessionSettings(
            self.provider, self.strict, self.threads, require_signature=self.require_signature
        )


def main() -> None:
    """Do the job on standard input; an error of the project is one line and its exit code."""
    job = Job(**json.load(sys.stdin))
    try:
        result = _TASKS[job.task](job)
    except EdgetreeError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(error.exit_code)
    json.dump(result, sys.stdout, allow_nan=False)


def _open(job: Job) -> tuple[TreeDetector, list[BenchFrame], float]:
    """The detector, the frames that can be read, and the time to load in milliseconds."""
    start = time.perf_counter()
    detector = TreeDetector(OrtSession(Path(job.model), job.session))
    load_ms = (time.perf_counter() - start) * 1000
    source = None if job.source is None else Path(job.source)
    return detector, bench_frames(source, detector), load_ms


def _round(job: Job) -> Record:
    detector, frames, load_ms = _open(job)
    images = [frame.image for frame in frames]
    energy: list[EnergyCounter] = []
    times_ms, trees = call_times_ms(
        detector,
        images,
        batch=job.batch,
        duration_s=job.duration_s,
        on_begin=lambda: energy.append(EnergyCounter()),
    )
    joules, count = energy[0].joules(), len(times_ms) * job.batch
    return {
        "load_ms": load_ms,
        "times_ms": [round(each, 4) for each in times_ms],
        "trees_per_frame": trees / count,
        "peak_memory_mib": peak_memory_mib(),
        "energy_j_per_frame": None if joules is None else joules / count,
        "provider": detector.session.provider,
        **sensor_values(),
    }


def _detail(job: Job) -> Record:
    path = Path(job.model)
    detector, frames, _ = _open(job)
    manifest = detector.manifest
    size = detector.session.input_shapes[manifest.input.name][0]
    rows = size if isinstance(size, int) else 1
    pictures = [detector.prepare(frame.image) for frame in frames]
    inputs = [detector.inputs_of(np.repeat(each[None], rows, axis=0)) for each in pictures]
    times = network_times(path, job.session, inputs)
    one_frame = {part: ms / rows for part, ms in times.parts_ms.items()}
    placement = getattr(detector.session, "placement", {})
    content = read_regular(path)
    return {
        **model_record(manifest),
        "file_bytes": len(content),
        "file_sha256": hashlib.sha256(content).hexdigest(),
        "graph_batch": rows,
        "graph_multiply_adds": count_multiply_adds(path, inputs[0]) // rows,
        "frames": len(frames),
        "stages_ms": stages_ms(frames, lambda kind: kind(path, job.session), one_frame),
        "operators": [dataclasses.asdict(each) for each in times.operators],
        "nodes": placement or {"cpu": {each.operator: each.nodes for each in times.operators}},
    }


def _heat(job: Job) -> Record:
    """Times, clock and temperature at up to sixty moments of a long run."""
    detector, frames, _ = _open(job)
    images = [frame.image for frame in frames]
    point_s = max(job.duration_s / _HEAT_POINTS, _SHORTEST_POINT_S)
    points: list[Record] = []
    start = time.perf_counter()
    while (gone_s := time.perf_counter() - start) < job.duration_s:
        times_ms, _ = call_times_ms(detector, images, batch=job.batch, duration_s=point_s)
        p50, p99 = (round(float(each), 3) for each in np.percentile(times_ms, (50, 99)))
        point = {"minute": round((gone_s + point_s / 2) / 60, 3), "p50_ms": p50, "p99_ms": p99}
        point["fps"] = round(len(times_ms) * job.batch / sum(times_ms) * 1000, 3)
        points.append({**point, **sensor_values()})
    return {"points": points}


_TASKS: Final[dict[str, Callable[[Job], Record]]] = {
    "round": _round,
    "detail": _detail,
    "heat": _heat,
    "peak": lambda job: machine_peak(job.threads, job.duration_s),
}

if __name__ == "__main__":
    main()
