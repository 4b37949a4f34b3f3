"""Times of calls, taken in turn so that other load on the machine disturbs all alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from typing import TypeVar

Name = TypeVar("Name", bound=Hashable)


def time_ms(call: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    """Time of one call, ms.

    Args:
        call: What to time.
        clock: Seconds; `time.thread_time` and `time.process_time` count processor time.
    """
    start_s = clock()
    call()
    return (clock() - start_s) * 1000


def in_turn(
    calls: Mapping[Name, Callable[[int], object]],
    rounds: int,
    warm_up: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[Name, list[float]]:
    """Times of calls in ms by name, each called once in a round.

    Args:
        calls: What to time; each gets the number of the round.
        rounds: Rounds that count.
        warm_up: Rounds before them.
        clock: As for `time_ms`.
    """
    times: dict[Name, list[float]] = {name: [] for name in calls}
    for number in range(warm_up + rounds):
        for name, call in calls.items():
            taken_ms = time_ms(partial(call, number), clock)
            if number >= warm_up:
                times[name].append(taken_ms)
    return times


def medians(rows: Sequence[Mapping[str, float]], digits: int = 4) -> dict[str, float]:
    """Median of each value over the rounds."""
    return {name: round(statistics.median(row[name] for row in rows), digits) for name in rows[0]}
