"""The table of different stems that are counted without metres."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from benchmarks.figures.pages import stored, table

_RATES = {"every 1": "10 Hz", "every 2": "5 Hz", "every 5": "2 Hz"}


def counted_stems() -> Iterator[str]:
    """Sums over all drives, by the rate of the frames."""
    sums: dict[str, Counter[str]] = {}
    for name, counts in stored("counting").items():
        sums.setdefault(name.rpartition(", ")[2], Counter()).update(counts)
    rows = [
        [_RATES[step], *(f"{found[key]:,}" for key in ("detections", "true", "counted", "twice"))]
        for step, found in sums.items()
    ]
    return table(["Rate", "Detections", "True", "Counted", "Counted twice"], rows)


TABLES = {"counted-stems": counted_stems}
