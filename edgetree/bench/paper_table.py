"""The paper's table of backbones, with measurements on this machine next to the paper's values.

The paper gives the parameters and multiply-adds of the ImageNet classifiers at 224x224 px, and the
frames per second of the whole detector at 800x800 px. The counts of its X101 are those of
ResNeXt-101 32x4d, although its published code and weights are 32x8d.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

__all__ = ["PAPER", "PAPER_GPU", "PaperRow", "table_lines", "table_record"]

SCHEMA: Final = "edgetree.bench-table/1"
PAPER_GPU: Final = "RTX 3090"
_GIGA: Final = 1e9
_MEGA: Final = 1e6
_UNKNOWN: Final = "-"

Record = Mapping[str, Any]


@dataclass(frozen=True)
class PaperRow:
    """A row of the paper's table.

    Attributes:
        name: name of the backbone in the paper.
        counted_network: this project's name of the network that the counts belong to.
        parameters: parameters of the ImageNet classifier.
        multiply_adds: multiply-adds of the ImageNet classifier at 224x224 px; the paper calls them
            FLOPs.
        fps: frames per second of the detector at 800x800 px on `PAPER_GPU`.
    """

    name: str
    counted_network: str
    parameters: int
    multiply_adds: int
    fps: float


_X101: Final = PaperRow("X101-FPN", "x101-32x4d", 44_000_000, 7_990_000_000, 10.0)
PAPER: Final[dict[str, PaperRow]] = {
    "r50": PaperRow("R50-FPN", "r50", 25_600_000, 3_860_000_000, 18.0),
    "r101": PaperRow("R101-FPN", "r101", 44_700_000, 7_580_000_000, 15.0),
    "x101-32x4d": _X101,
    "x101-32x8d": _X101,
}


def table_record(benches: Mapping[str, Record]) -> dict[str, Any]:
    """The table as one JSON object.

    Args:
        benches: JSON objects of `edgetree bench --json` by name of the network.
    """
    rows = []
    for name, bench in benches.items():
        paper = PAPER.get(name)
        rows.append({"backbone": name, "paper": paper and asdict(paper), "bench": dict(bench)})
    return {
        "schema": SCHEMA,
        "paper_gpu": PAPER_GPU,
        "flops": "2 per multiply-add",
        "rows": rows,
    }


_WIDTHS: Final = (10, 7, 6, 7, 6, 7, 8, 8, 8, 7, 7, 6, 6, 7)
# Headings, and the number of columns that each spans.
_GROUPS: Final = (("", 1), (" classifier, 224x224 ", 4), (" this file ", 4), (" this machine ", 5))
_QUANTITIES: Final = (
    ("", 1),
    ("params M", 2),
    ("mult-adds G", 2),
    ("params", 1),
    ("pro-", 1),
    ("mult-", 1),
    ("FLOPs", 1),
    ("p50", 1),
    ("p90", 1),
    ("FPS", 2),
    ("memory", 1),
)
_UNITS: Final = (
    "backbone",
    "here",
    "paper",
    "here",
    "paper",
    "M",
    "posals",
    "adds G",
    "G",
    "ms",
    "ms",
    "here",
    "paper",
    "MiB",
)


def _count(value: float | None, unit: float, decimals: int) -> str:
    return _UNKNOWN if value is None else f"{value / unit:.{decimals}f}"


def _cells(row: Record) -> list[str]:
    bench, paper = row["bench"], row["paper"] or {}
    classifier = bench["classifier"] or {}
    p50_ms = bench["detect_p50_ms"]
    decimals = 1 if p50_ms < 100 else 0
    return [
        row["backbone"],
        _count(classifier.get("parameters"), _MEGA, 1),
        _count(paper.get("parameters"), _MEGA, 1),
        _count(classifier.get("multiply_adds"), _GIGA, 2),
        _count(paper.get("multiply_adds"), _GIGA, 2),
        _count(bench["parameters"], _MEGA, 1),
        _count(bench["proposals"], 1, 0),
        _count(bench["multiply_adds"], _GIGA, 1),
        _count(bench["flops"], _GIGA, 1),
        f"{p50_ms:.{decimals}f}",
        f"{bench['detect_p90_ms']:.{decimals}f}",
        _count(bench["fps"], 1, 1 if bench["fps"] >= 10 else 2),
        _count(paper.get("fps"), 1, 0),
        _count(bench["peak_memory_mib"], 1, 0),
    ]


def table_lines(record: Record) -> Iterator[str]:
    """The table of `table_record` as text, at most 100 columns wide, with explanations."""
    rows = record["rows"]
    first = rows[0]["bench"]
    width, height = first["input_px"]
    yield (
        f"{width}x{height} px, {first['precision']}, on {first['provider']},"
        f" {first['threads']} thread(s),"
        " one frame at a time"
    )
    yield ""
    yield _heading(_GROUPS)
    yield _heading(_QUANTITIES)
    yield _line(_UNITS)
    for row in rows:
        yield _line(_cells(row))
    yield ""
    yield from _notes(rows)


def _heading(spans: tuple[tuple[str, int], ...]) -> str:
    """A line of headings: centred if they span several columns, else right-aligned."""
    parts, begin = [], 0
    for text, count in spans:
        size = sum(_WIDTHS[begin : begin + count])
        ruled = f"  {text:-^{size - 2}}" if text.startswith(" ") else f"{text:^{size}}"
        parts.append(ruled if count > 1 else f"{text:>{size}}")
        begin += count
    return "".join(parts).rstrip()


def _line(cells: Sequence[str]) -> str:
    first, *rest = zip(cells, _WIDTHS, strict=True)
    return f"{first[0]:{first[1]}}" + "".join(f"{text:>{width}}" for text, width in rest)


def _notes(rows: Sequence[Record]) -> Iterator[str]:
    names = {row["backbone"] for row in rows}
    yield "mult-adds: multiply-adds; FLOPs: 2 per multiply-add. Paper: parameters and multiply-adds"
    yield "of the backbone as ImageNet classifier at 224x224 px, like the columns next to them;"
    yield f"FPS of the whole network at 800x800 px on an {PAPER_GPU}."
    if names & {"x101-32x4d", "x101-32x8d"}:
        yield "X101: the paper counts ResNeXt-101 32x4d; its published code and weights are 32x8d."
    silent = [row["backbone"] for row in rows if row["bench"]["multiply_adds"] is None]
    if silent:
        yield f"No multiply-adds in older files; export these again: {', '.join(silent)}."
    untrained = [row["backbone"] for row in rows if not row["bench"]["trained"]]
    if untrained:
        yield f"Untrained, for speed only: {', '.join(untrained)}."
    for row in rows:
        box_ap = row["bench"]["box_ap"]
        if box_ap is not None:
            yield f"{row['backbone']}: box AP {box_ap:.1f}, on the labelled frames of its export."
