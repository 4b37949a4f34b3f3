"""Print the scores of rows of scenes.

python -m benchmarks.metres.run --seeds 1000 1060 --result benchmarks/results/metres.json
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from benchmarks.metres.rows import ROWS
from benchmarks.metres.scores import lines, score


def main() -> None:
    """Render, measure, print, and optionally write the scores."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("rows", nargs="*", help="all by default")
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1050))
    parser.add_argument("--result", type=Path)
    options = parser.parse_args()
    if unknown := sorted(set(options.rows) - set(ROWS)):
        names = ", ".join(sorted(ROWS))
        parser.error(f"no row is called {', '.join(unknown)}: expected some of {names}")
    report = {}
    for row in options.rows or sorted(ROWS):
        scores = score(
            reading
            for seed in range(*options.seeds)
            for reading in ROWS[row](np.random.default_rng(seed))
        )
        report[row] = scores
        sys.stdout.write("\n".join(lines(row, scores)) + "\n")
        sys.stdout.flush()
    if options.result is not None:
        options.result.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
