"""Print the scores of cameras of other sizes and kinds.

python -m benchmarks.sensors.run --result benchmarks/results/sensors.json
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.metres.scores import lines, score
from benchmarks.sensors.captures import phone, portrait, scan, scan_readings
from benchmarks.sensors.control import SENSORS, SIZES, draw
from benchmarks.sensors.views import NETWORKS, OUTLINES, View, readings
from benchmarks.sensors.whole_cloud import whole_cloud

Cells = Iterator[tuple[str, dict[str, Any]]]


def control(seeds: Iterable[int], sources: list[str]) -> Cells:
    """Cylinders by size, sensor and outline."""
    for size, sensor in product(SIZES, SENSORS):
        views = [draw(np.random.default_rng(seed), size, sensor) for seed in seeds]
        name = f"control {size[0]}x{size[1]} {sensor}"
        yield from _scores(name, views, sources, "dbh_m")


def _scores(
    name: str,
    views: list[View],
    sources: Iterable[str],
    quantity: str,
    read: Callable[[View, str], Any] = readings,
) -> Cells:
    for source in sources:
        pairs = (pair for view in views for pair in read(view, source))
        yield f"{name} {source}", score(pairs, (quantity,))


def _phone(seeds: Iterable[int], sources: list[str]) -> Cells:
    yield from _scores("phone", list(phone()), sources, "diameter_m")


def _portrait(seeds: Iterable[int], sources: list[str]) -> Cells:
    yield from _scores("portrait", list(portrait()), sources, "diameter_m")


def _scan(seeds: Iterable[int], sources: list[str]) -> Cells:
    networks = [source for source in sources if source != OUTLINES]
    for ground in (True, False):
        name = f"scan {'with' if ground else 'without'} ground"
        yield from _scores(name, list(scan(ground)), networks, "dbh_m", scan_readings)


def _cloud(seeds: Iterable[int], sources: list[str]) -> Cells:
    for source in sources:
        for circles in (False, True) if source != OUTLINES else ():
            name = f"cloud by {'outlines and circles' if circles else 'outlines'} {source}"
            yield name, score(whole_cloud(source, circles), ("dbh_m",))


ROWS = {
    "control": control,
    "phone": _phone,
    "portrait": _portrait,
    "scan": _scan,
    "cloud": _cloud,
}


def main() -> None:
    """Measure, print, and optionally write the scores."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("rows", nargs="*", help=f"of {', '.join(ROWS)}; all by default")
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1036))
    parser.add_argument("--sources", nargs="+", default=[OUTLINES, *NETWORKS])
    parser.add_argument("--result", type=Path)
    options = parser.parse_args()
    report = {}
    for row in options.rows or ROWS:
        for name, scores in ROWS[row](range(*options.seeds), options.sources):
            report[name] = scores
            sys.stdout.write("\n".join(lines(name, scores)) + "\n")
            sys.stdout.flush()
    if options.result is not None:
        options.result.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
