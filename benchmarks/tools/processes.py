"""Memory, open files, threads and time of processes. Needs Linux, for /proc."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

PROC = Path("/proc")


def memory_mib(process: int | str, file: str, line: str) -> float:
    """A value of a file of `/proc/PROCESS`, MiB; 0 if the process has ended.

    Args:
        process: Its id, or "self".
        file: "status" with the lines VmRSS, VmHWM (its peak) and RssAnon (without mapped files), or
            "smaps_rollup" with Pss (shared memory divided among its users).
        line: Name of the line.
    """
    try:
        lines = (PROC / str(process) / file).read_text("ascii", "replace").splitlines()
    except OSError:
        return 0.0
    return next((int(x.split()[1]) / 1024 for x in lines if x.startswith(f"{line}:")), 0.0)


def family(process: int) -> list[int]:
    """Ids of a process and all its descendants."""
    found = [process]
    for task in (PROC / str(process) / "task").glob("*/children"):
        for child in task.read_text("ascii").split():
            found += family(int(child))
    return found


class Usage:
    """Memory, open files and threads of this process over a long run, one row a look.

    The rows are written in full before the run, so that it takes no more memory as it goes on.

    Args:
        most: Largest number of looks.
    """

    def __init__(self, most: int) -> None:
        self._rows = np.full((most, 4), np.nan)
        self._count = 0

    def look(self, time_s: float) -> None:
        """Note what this process uses at a time of the run."""
        files, threads = (len(os.listdir(PROC / "self" / name)) for name in ("fd", "task"))
        resident_mib = memory_mib("self", "status", "VmRSS")
        self._rows[self._count] = time_s, resident_mib, files, threads
        self._count += 1

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times of the looks."""
        return self._rows[: self._count, 0]

    @property
    def resident_mib(self) -> NDArray[np.float64]:
        """Resident memory at each look."""
        return self._rows[: self._count, 1]

    def handles(self) -> tuple[dict[str, list[int]], bool]:
        """Open files and threads after a tenth, at the end and at most; and whether they grew.

        They grew if all of the last tenth are more than any of the second tenth.
        """
        tenth = self._count // 10
        found: dict[str, list[int]] = {}
        grown = False
        for column, name in ((2, "open_files"), (3, "threads")):
            values = self._rows[: self._count, column]
            found[name] = [int(values[tenth]), int(values[-1]), int(values.max())]
            second = values[tenth : 2 * tenth]
            grown |= bool(tenth and values[-tenth:].min() > second.max())
        return found, grown


def percentiles(
    values: NDArray[Any], part: NDArray[np.int_], digits: int
) -> dict[str, list[float]]:
    """Median and 99th percentile of the values of each part of a run.

    Args:
        values: (N,) values.
        part: (N,) number of the part of each.
        digits: Digits to round to.
    """
    parts = [values[part == number] for number in np.unique(part)]
    return {
        f"p{percent}": [round(float(np.percentile(each, percent)), digits) for each in parts]
        for percent in (50, 99)
    }
