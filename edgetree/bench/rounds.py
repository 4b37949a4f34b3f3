"""Measure variants of models in turn, each measurement in a process of its own.

In each round every variant is measured once, so that a disturbance of the machine affects all of
them. A variant's time is the median of its rounds; how they differ is its noise.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np

from basetree.counts import counted
from basetree.errors import CheckFailed, InputError
from basetree.program.python import run_python
from basetree.settings import Settings, label, limits
from edgetree.bench.worker import Job

_BINS: Final = 30
_PEAK_S: Final = 0.5
_USAGE: Final = 2

Record = dict[str, Any]
Say = Callable[[str], None]


@dataclass(frozen=True)
class Variant:
    """A model file in one way of running it.

    Attributes:
        name: Name of the model in results.
        path: The file.
        threads: Threads of one inference.
        batch: Frames that are handed over together.
    """

    name: str
    path: Path
    threads: int
    batch: int = 1

    def __str__(self) -> str:
        """The variant in progress messages."""
        return f"{self.name}, {counted(self.threads, 'thread')}, batch {self.batch}"


@dataclass(frozen=True)
class BenchSettings(Settings, error=InputError):
    """How to measure."""

    rounds: int = field(default=5, metadata=limits(1, expected="1 or more") | label("--rounds"))
    """Number of rounds."""
    duration_s: float = 1.0
    """Time to measure a variant for in each round."""
    minutes: float = field(
        default=0.0, metadata=limits(0, expected="0 or more") | label("--minutes")
    )
    """Length of the run after the rounds that shows how each variant heats the machine; 0 for
    none."""
    provider: str = "cpu"
    """As for `TreeDetector.load`."""
    strict: bool = True
    """Likewise."""
    require_signature: bool = False
    """Likewise."""
    source: Path | None = None
    """Frames as for `edgetree.bench.frames.bench_frames`."""

    def job(self, task: Any, variant: Variant, duration_s: float = 0.0) -> Job:
        """A job of a variant."""
        return Job(
            task=task,
            threads=variant.threads,
            model=str(variant.path),
            provider=self.provider,
            strict=self.strict,
            require_signature=self.require_signature,
            source=None if self.source is None else str(self.source),
            batch=variant.batch,
            duration_s=duration_s,
        )


def count_runs(variants: Sequence[Variant], settings: BenchSettings) -> int:
    """The number of processes that `measure_variants` runs."""
    peaks = len({variant.threads for variant in variants})
    details = len({(variant.path, variant.threads) for variant in variants})
    return peaks + details + len(variants) * (settings.rounds + bool(settings.minutes))


def measure_variants(
    variants: Sequence[Variant],
    settings: BenchSettings,
    say: Say,
    ended: Callable[[], object] = lambda: None,
) -> Record:
    """Measure variants in turn.

    Args:
        variants: What to measure.
        settings: How to measure.
        say: Called with progress messages.
        ended: Called after each process.

    Returns:
        `peak` by number of threads, and `rows`, one for each variant.

    Raises:
        CheckFailed: a process failed.
        InputError: a process rejected its input.
    """

    def run(job: Job) -> Any:
        found = _run(job)
        ended()
        return found

    counts = sorted({variant.threads for variant in variants})
    say("measuring the machine's matrix products")
    peak_s = min(settings.duration_s, _PEAK_S)
    peak = {str(count): run(Job("peak", count, duration_s=peak_s)) for count in counts}
    details: dict[tuple[Path, int], Record] = {}
    for variant in variants:
        if (variant.path, variant.threads) not in details:
            say(f"cost and stages: {variant.name}, {counted(variant.threads, 'thread')}")
            details[variant.path, variant.threads] = run(settings.job("detail", variant))
    rounds: list[list[Record]] = [[] for _ in variants]
    for number in range(1, settings.rounds + 1):
        say(f"round {number} of {settings.rounds}")
        for variant, done in zip(variants, rounds, strict=True):
            done.append(run(settings.job("round", variant, settings.duration_s)))
    rows = [
        _row(variant, details[variant.path, variant.threads], done, peak[str(variant.threads)])
        for variant, done in zip(variants, rounds, strict=True)
    ]
    if settings.minutes:
        for variant, row in zip(variants, rows, strict=True):
            say(f"{settings.minutes:g} minutes without a pause: {variant}")
            row["heat"] = run(settings.job("heat", variant, settings.minutes * 60))["points"]
    return {"peak": peak, "rows": rows}


def _run(job: Job) -> Record:
    done = run_python("-m", "edgetree.bench.worker", given=json.dumps(asdict(job)))
    if done.returncode == 0:
        record: Record = json.loads(done.stdout)
        return record
    lines = done.stderr.strip().splitlines()
    reason = lines[-1] if lines else "no error message"
    if done.returncode == _USAGE:
        raise InputError(reason)
    killed = " (out of memory?)" if done.returncode < 0 else ""
    raise CheckFailed(
        f"the benchmark of {job.model or 'the machine'} ended with exit code"
        f" {done.returncode}{killed}: {reason}"
    )


def _row(variant: Variant, detail: Record, rounds: list[Record], peak: Record) -> Record:
    """The figures of one variant."""
    pooled = [each for done in rounds for each in done["times_ms"]]
    found = [_round_figures(done, variant.batch) for done in rounds]
    seconds = median(each["p50_ms"] for each in found) / 1000 / variant.batch
    rate = detail["graph_multiply_adds"] / seconds / 1e9
    known = peak.get("int8" if detail["precision"] == "int8" else "float32")
    energies = [each["energy_j_per_frame"] for each in rounds]
    memory = [each["peak_memory_mib"] for each in rounds]
    return {
        **detail,
        "name": variant.name,
        "file": str(variant.path),
        "provider": rounds[0]["provider"],
        "threads": variant.threads,
        "batch": variant.batch,
        "runs": len(pooled),
        **{key: round(median(each[key] for each in found), 3) for key in _TIMES},
        "rounds": found,
        "histogram": _histogram(pooled),
        "load_ms": round(median(each["load_ms"] for each in rounds), 1),
        "trees_per_frame": round(rounds[0]["trees_per_frame"], 2),
        "peak_memory_mib": None if None in memory else round(max(memory), 1),
        "energy_j_per_frame": None if None in energies else round(median(energies), 4),
        "giga_multiply_adds_per_s": round(rate, 1),
        "share_of_peak": None if not known else round(rate / known, 4),
    }


_TIMES: Final = ("p50_ms", "p90_ms", "p99_ms", "fps")


def _round_figures(done: Record, batch: int) -> Record:
    times = done["times_ms"]
    p50, p90, p99 = (round(float(each), 3) for each in np.percentile(times, (50, 90, 99)))
    return {
        "p50_ms": p50,
        "p90_ms": p90,
        "p99_ms": p99,
        "fps": round(len(times) * batch / sum(times) * 1000, 3),
        "runs": len(times),
        "clock_mhz": done["clock_mhz"],
        "temperature_c": done["temperature_c"],
    }


def _histogram(times_ms: list[float]) -> Record:
    """Counts of times in equal bins; the last bin also holds the slowest hundredth."""
    low, high = min(times_ms), float(np.percentile(times_ms, 99))
    edges = np.linspace(low, max(high, low * 1.01), _BINS + 1)
    counts, _ = np.histogram(np.minimum(times_ms, edges[-1]), bins=edges)
    return {"edges_ms": [round(float(edge), 3) for edge in edges], "counts": counts.tolist()}
