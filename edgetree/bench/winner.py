"""Which variant of a benchmark is the fastest, if that can be told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from basetree.program.load import busy_words
from edgetree.bench.noise import LEAST_SHARE, noise_of

Record = Mapping[str, Any]


def fastest_rows(result: Record) -> list[Record]:
    """The rows of which none is faster than another beyond the noise of their rounds.

    It is the row with the shortest time of a frame, with those that are not slower than it by more
    than the noise of both, as `noise_of` takes it. Empty on a busy machine.
    """
    rows: Sequence[Record] = result["rows"]
    environment = result["environment"]
    if busy_words(environment.get("busy_cores"), environment.get("cores")):
        return []
    best = min(rows, key=frame_ms)
    return [row for row in rows if frame_ms(row) <= frame_ms(best) * (1 + _noise(row, best))]


def frame_ms(row: Record) -> float:
    """Median time of a frame."""
    return float(row["p50_ms"] / row["batch"])


def verdict(result: Record, names: Sequence[str]) -> str:
    """One sentence about the fastest variant; empty if there is only one.

    Args:
        result: A result.
        names: The name of each row.
    """
    environment, rows = result["environment"], result["rows"]
    busy = busy_words(environment.get("busy_cores"), environment.get("cores"))
    if busy:
        return f"Busy machine: {busy}, so that times are too long and no variant is the fastest."
    if len(rows) < 2:
        return ""
    found = fastest_rows(result)
    called = ", ".join(name for row, name in zip(rows, names, strict=True) if row in found)
    if len(found) == 1:
        return f"Fastest: {called}."
    return f"No fastest variant: these are as fast as each other within their noise: {called}."


def _noise(row: Record, best: Record) -> float:
    noises = [noise_of([each["p50_ms"] for each in part["rounds"]]) for part in (row, best)]
    return 0.0 if row is best else max(LEAST_SHARE, sum(noises))
