"""A result of `edgetree bench` as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from basetree.counts import counted
from edgetree.bench.cells import number_text, share_text
from edgetree.bench.paper_table import paper_lines
from edgetree.bench.result import notes, size_text
from edgetree.bench.stages import STAGES

_COLUMNS: Final = (
    "size",
    "prec.",
    "thr",
    "bat",
    "p50 ms",
    "p90 ms",
    "p99 ms",
    "FPS",
    "MiB",
    "peak",
    "AP",
)
_LONGEST_NAME: Final = 22
_GAP: Final = "  "
_OPERATORS: Final = 4

Record = Mapping[str, Any]


def text_lines(result: Record) -> Iterator[str]:
    """The result as lines: the table, where the time goes, the paper's table, and notes."""
    rows = result["rows"]
    yield from _table(rows)
    yield ""
    yield "where the time goes, ms of a frame:"
    seen = set()
    for row in rows:
        key = (row["name"], row["precision"], tuple(row["input_px"]), row["threads"])
        if key not in seen:
            seen.add(key)
            yield from _stages(row)
    networks = [row for row in rows if row["network"] is not None]
    if networks:
        yield ""
        yield from paper_lines(networks)
    yield ""
    yield from notes(result)


def _table(rows: Sequence[Record]) -> Iterator[str]:
    """The rows with a head; without the column of batches if every batch is one frame."""
    several = any(row["batch"] > 1 for row in rows)
    lines: list[tuple[str, ...]] = [("model", *_COLUMNS)]
    lines += [(_name(row), *_cells(row)) for row in rows]
    columns = [
        [f"{text:<{width}}" if index == 0 else f"{text:>{width}}" for text in texts]
        for index, texts in enumerate(zip(*lines, strict=True))
        if (width := max(map(len, texts))) and (several or texts[0] != "bat")
    ]
    for cells in zip(*columns, strict=True):
        yield _GAP.join(cells)


def _name(row: Record) -> str:
    name: str = row["name"]
    return name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 2]}.."


def _cells(row: Record) -> list[str]:
    accuracy = row.get("accuracy") or {}
    times = (row[key] for key in ("p50_ms", "p90_ms", "p99_ms"))
    return [
        size_text(row),
        row["precision"],
        str(row["threads"]),
        str(row["batch"]),
        *(f"{value:.{1 if value < 1000 else 0}f}" for value in times),
        f"{row['fps']:.{1 if row['fps'] >= 10 else 2}f}",
        number_text(row["peak_memory_mib"], 0),
        share_text(row["share_of_peak"]),
        number_text(accuracy.get("box_ap"), 1),
    ]


def _stages(row: Record) -> Iterator[str]:
    stages = row["stages_ms"]
    parts = ", ".join(f"{name} {stages[name]:.1f}" for name in STAGES if stages[name] is not None)
    operators = ", ".join(
        f"{each['operator']} {each['ms']:.1f}" for each in row["operators"][:_OPERATORS]
    )
    heading = (
        f"{row['name']} {row['precision']} {size_text(row)}, {counted(row['threads'], 'thread')}"
    )
    yield f"  {heading}"
    yield f"    {parts}"
    yield f"    operators: {operators}"
