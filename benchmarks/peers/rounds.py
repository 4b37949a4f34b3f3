"""The order of the runs, and the figures of all rounds of a contestant."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

Record = dict[str, Any]


def turns(names: Sequence[str], rounds: int) -> Iterator[tuple[int, str]]:
    """Number of the round, from 1 on, and contestant of each run.

    Each contestant runs once in a round. Every second round runs backwards, so that a machine that
    slows down or heats up during a round treats the first and the last alike.
    """
    for number in range(1, rounds + 1):
        for name in names if number % 2 else reversed(names):
            yield number, name


def merge(records: Sequence[Mapping[str, Any]]) -> Record:
    """The figures of a contestant.

    Args:
        records: What its worker reported in each round that it took part in: the times of the runs,
            the times to load the file and of the first run, and the peak memory.

    Returns:
        The median over the rounds of the rounds' medians, the range of these, and the 90th
        percentile over all runs. Memory is the largest, loading and the first run are medians.
    """
    rounds_ms = {record["round"]: statistics.median(record["times_ms"]) for record in records}
    medians_ms = list(rounds_ms.values())
    times_ms = [time for record in records for time in record["times_ms"]]
    peaks = [record["peak_memory_mib"] for record in records]
    return {
        "median_ms": round(statistics.median(medians_ms), 2),
        "rounds_ms": {number: round(median_ms, 2) for number, median_ms in rounds_ms.items()},
        "spread_ms": round(max(medians_ms) - min(medians_ms), 2),
        "p90_ms": round(float(np.percentile(times_ms, 90)), 2),
        "runs": len(times_ms),
        "load_ms": round(statistics.median(record["load_ms"] for record in records), 1),
        "first_run_ms": round(statistics.median(record["first_run_ms"] for record in records), 1),
        "peak_memory_mib": None if None in peaks else round(max(peaks), 1),
    }


def ratio(rounds_ms: Mapping[int, float], reference_ms: Mapping[int, float]) -> float:
    """Median of the ratios within a round, which other load on the machine changes least.

    Args:
        rounds_ms: Median time by round of a contestant.
        reference_ms: That of the reference, which took part in the same rounds at least.
    """
    ratios = [time_ms / reference_ms[number] for number, time_ms in rounds_ms.items()]
    return round(statistics.median(ratios), 2)
