"""Shares of true values inside the stated intervals, at several levels, on simulated frames.

python -m benchmarks.coverage --data FOLDER [--test] --result benchmarks/results/coverage.json

For each quantity and source (exact outlines "labels", those of `edge-n-depth` "network", the same
without a given vertical "no-vertical", those of `edge-s-depth` by its name): the number of values,
the share inside each interval, the share beyond 3 standard deviations, the largest error in
standard deviations, and the median of the absolute errors in the same unit, which is 0.67 for
normal errors. The frames are those of
`benchmarks.fit_measure`: to choose on, or with `--test` those to compare on.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from basetree.arrays import Float
from benchmarks.fit_cases import Case, read_all, say
from benchmarks.fit_measure import FIT_FRAMES, MODEL, QUANTITIES, SOURCES, TEST_FRAMES
from edgetree import TreeDetector
from edgetree.catalogue import find_model
from edgetree.measure import Estimate

LEVELS: Final = (0.5, 0.68, 0.9, 0.95, 0.99)
LARGER_MODEL: Final = "edge-s-depth"
_SURE_STDS = 3.0


def normalized_errors(cases: list[Case], sources: Sequence[str]) -> dict[tuple[str, str], Float]:
    """Errors in stated standard deviations, (N,) by quantity and source."""
    errors: dict[tuple[str, str], list[float]] = defaultdict(list)
    for source in sources:
        for case in cases:
            for number, tree in case.measured(source, {}):
                for quantity in QUANTITIES.values():
                    for reading in case.of_tree(quantity, number, tree):
                        errors[quantity, source].append(reading.error / reading.std)
    return {key: np.array(values) for key, values in errors.items()}


def coverage(errors: Float) -> dict[str, Any]:
    """Shares inside the interval of each level, and the tails, of (N,) normalized errors."""
    size = np.abs(errors)
    half_widths = [Estimate(0.0, 1.0).interval(level)[1] for level in LEVELS]
    return {
        "given": len(size),
        "inside": {
            str(level): round(float((size <= half).mean()), 4)
            for level, half in zip(LEVELS, half_widths, strict=True)
        },
        "beyond_3_std": round(float((size > _SURE_STDS).mean()), 4),
        "largest": round(float(size.max()), 2),
        "median": round(float(np.median(size)), 3),
        "rms": round(float(np.sqrt((size**2).mean())), 3),
    }


def row(name: str, shares: dict[str, Any]) -> str:
    """One line of the printed table."""
    inside = " / ".join(f"{100 * share:.0f}" for share in shares["inside"].values())
    return (
        f"{name}: {shares['given']} given, {inside} % inside,"
        f" {100 * shares['beyond_3_std']:.1f} % beyond 3 sigma, largest {shares['largest']},"
        f" median {shares['median']}, RMS {shares['rms']}"
    )


def main() -> None:
    """Print the shares of every quantity and source, and write them to a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of the datasets")
    parser.add_argument("--test", action="store_true", help="the frames to compare on")
    parser.add_argument("--frames", type=int, help="at most this many of each dataset")
    parser.add_argument("--result", type=Path)
    options = parser.parse_args()
    chosen = TEST_FRAMES if options.test else FIT_FRAMES
    results = {}
    for model, sources in ((MODEL, SOURCES), (LARGER_MODEL, ("network",))):
        detector = TreeDetector.load(find_model(model), threads=1, score_threshold=0.5)
        cases = read_all(options.data, chosen, detector, options.frames)
        for (quantity, source), errors in normalized_errors(cases, sources).items():
            name = f"{quantity}, {source if model == MODEL else model}"
            results[name] = coverage(errors)
            say(row(name, results[name]))
    if options.result is not None:
        options.result.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
