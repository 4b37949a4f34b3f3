"""A result of `edgetree bench` as text for a terminal of 100 columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from textwrap import wrap
from typing import Any, Final

from basetree.counts import counted
from edgetree.bench.cells import number_text, share_text
from edgetree.bench.paper_table import paper_lines
from edgetree.bench.result import notes, size_text
from edgetree.bench.stages import STAGES

_COLUMNS: Final = (
    ("size", 9),
    ("prec.", 9),
    ("thr", 4),
    ("bat", 4),
    ("p50 ms", 8),
    ("p90 ms", 8),
    ("p99 ms", 8),
    ("FPS", 7),
    ("MiB", 6),
    ("peak", 6),
    ("AP", 6),
)
_NAME_WIDTH: Final = 22
_OPERATORS: Final = 4
_WIDEST: Final = 100

Record = Mapping[str, Any]


def text_lines(result: Record) -> Iterator[str]:
    """The result as lines: the table, where the time goes, the paper's table, and notes."""
    rows = result["rows"]
    yield f"{'model':{_NAME_WIDTH}}" + "".join(f"{name:>{width}}" for name, width in _COLUMNS)
    for row in rows:
        cells = zip(_cells(row), _COLUMNS, strict=True)
        name = row["name"]
        shown = name if len(name) < _NAME_WIDTH else f"{name[: _NAME_WIDTH - 3]}.."
        yield f"{shown:{_NAME_WIDTH}}" + "".join(f"{text:>{width}}" for text, (_, width) in cells)
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
    for note in notes(result):
        yield from _wrapped(note)


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
    yield from _wrapped(parts, "    ")
    yield from _wrapped(f"operators: {operators}", "    ")


def _wrapped(text: str, indent: str = "") -> list[str]:
    return wrap(
        text,
        _WIDEST,
        initial_indent=indent,
        subsequent_indent=indent,
        break_on_hyphens=False,
        break_long_words=False,
    )
