"""The table of `measure.py` in Markdown.

python -m benchmarks.peers.table benchmarks/results/peers.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmarks.peers.contestants import SIDE_PX, WHOLE
from benchmarks.tools.program import command_line

COLUMNS = ("Contestant", "Gives", "Runs in", "Licence", "Median ms", "Ratio", "MiB")
UNKNOWN = "–"


def table_lines(result: Mapping[str, Any]) -> Iterator[str]:
    """The lines of the table, and notes that say what its numbers mean.

    Args:
        result: The JSON object of `measure.py`.
    """
    yield f"| {' | '.join(COLUMNS)} |"
    yield f"|{' --- |' * len(COLUMNS)}"
    for row in result["contestants"]:
        yield f"| {' | '.join(_cells(row))} |"
    for name, reason in result["absent"].items():
        yield f"| {name} | not measured: {reason} |{' |' * (len(COLUMNS) - 2)}"
    yield ""
    yield (
        f"Ratio: to `{result['reference']}`, median of the ratios within a round. MiB: peak memory"
        " of the process. Medians of"
        f" {result['rounds']} rounds, fewer for the slowest, {result['threads']} threads,"
        f" {result['machine']}."
    )
    yield (
        "Peers have untrained weights. Times are bare runs, from the input array ready in memory to"
        " the output arrays, without processing before and after; rows named"
        f" “{WHOLE}” are the whole `TreeDetector.detect`, from a frame of 1280x720 px in memory to"
        " its trees. The INT8 files of YOLO come from its package's own quantisation, calibrated on"
        " the same frames."
    )


def _cells(row: Mapping[str, Any]) -> list[str]:
    """The cells of a contestant."""
    name = row["name"]
    if row["timed"] == WHOLE:
        name += f" ({WHOLE})"
    elif row["input_px"] != [SIDE_PX, SIDE_PX]:
        name += f" ({row['input_px'][0]}x{row['input_px'][1]} px)"
    memory = row["peak_memory_mib"]
    return [
        name,
        ", ".join(row["gives"]),
        f"{row['runtime']}, {row['precision']}",
        row["licence"],
        _short(row["median_ms"]),
        f"{row['ratio']:.2f}",
        UNKNOWN if memory is None else f"{memory:.0f}",
    ]


def _short(value_ms: float) -> str:
    return f"{value_ms:.1f}" if value_ms < 100 else f"{value_ms:.0f}"


def main() -> None:
    """Print the table of a result file."""
    parser = command_line(__doc__)
    parser.add_argument("result", type=Path)
    arguments = parser.parse_args()
    result = json.loads(arguments.result.read_text(encoding="utf-8"))
    sys.stdout.write("\n".join(table_lines(result)) + "\n")


if __name__ == "__main__":
    main()
