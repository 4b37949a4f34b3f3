"""Results of `edgetree bench`: one JSON object, and its rows as CSV and Markdown."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from basetree.counts import counted
from edgetree.bench.cells import machine_words, number_text, share_text
from edgetree.bench.paper_table import PAPER, PAPER_GPU
from edgetree.bench.winner import verdict
from edgetree.results.csv_cells import text_cell

SCHEMA: Final = "edgetree.bench/2"

Record = Mapping[str, Any]

# Column of the table, and where its value is in a row.
_CSV: Final[dict[str, tuple[str, ...]]] = {
    **{
        name: (name,)
        for name in ("name", "backbone", "modality", "precision", "provider", "threads", "batch")
    },
    "width_px": ("input_px", "0"),
    "height_px": ("input_px", "1"),
    **{
        name: (name,)
        for name in (
            *("proposals", "parameters", "graph_multiply_adds", "file_bytes", "load_ms"),
            *("p50_ms", "p90_ms", "p99_ms", "fps", "runs", "trees_per_frame", "peak_memory_mib"),
            *("energy_j_per_frame", "giga_multiply_adds_per_s", "share_of_peak"),
        )
    },
    **{
        f"{stage}_ms": ("stages_ms", stage)
        for stage in (
            *("decode", "pre", "trunk", "pyramid", "proposals", "heads", "post", "measure"),
        )
    },
    **{
        name: ("accuracy", name)
        for name in ("box_ap", "mask_ap", "keypoint_ap", "diameter_error_mm")
    },
}
_GIGA: Final = 1e9


def make_result(
    measured: Record, environment: Record, method: Record, networks: Sequence[str | None]
) -> dict[str, Any]:
    """Make the JSON object of a benchmark.

    Args:
        measured: What `measure_variants` returned.
        environment: The machine and the versions of the libraries.
        method: How it was measured.
        networks: The network of each row that was asked for by name, or None.
    """
    rows = []
    for row, network in zip(measured["rows"], networks, strict=True):
        paper = None if network is None else PAPER.get(network)
        multiply_adds = row["graph_multiply_adds"]
        given = {"network": network, "paper": paper and paper.to_dict()}
        rows.append({**row, "graph_flops": 2 * multiply_adds, **given})
    return {
        "schema": SCHEMA,
        "environment": dict(environment),
        "method": dict(method),
        "units": {"flops": "2 per multiply-add", "peak": "10^9 multiply-adds per second"},
        "paper_gpu": PAPER_GPU,
        "peak": measured["peak"],
        "rows": rows,
    }


def size_text(row: Record) -> str:
    """The input size of a row, such as "640x384"."""
    width, height = row["input_px"]
    return f"{width}x{height}"


def row_label(row: Record) -> str:
    """What tells a row from the others, for people."""
    text = f"{row['name']} {row['precision']} {size_text(row)}, {counted(row['threads'], 'thread')}"
    return text if row["batch"] == 1 else f"{text}, batch {row['batch']}"


def csv_text(result: Record) -> str:
    """The rows of a result as CSV, one line for each, with units in the column names."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_CSV)
    for row in result["rows"]:
        values = (_at(row, keys) for keys in _CSV.values())
        writer.writerow([text_cell(each) if isinstance(each, str) else each for each in values])
    return stream.getvalue()


def _at(row: Any, keys: tuple[str, ...]) -> Any:
    for key in keys:
        if row is None:
            return ""
        row = row[int(key)] if isinstance(row, list) else row.get(key)
    return "" if row is None else row


def markdown_text(result: Record) -> str:
    """The rows of a result as a Markdown table, with machine, date and method below."""
    lines = ["| " + " | ".join(_HEAD) + " |", "| --- " * len(_HEAD) + "|"]
    lines += ["| " + " | ".join(_cells(row)) + " |" for row in result["rows"]]
    return "\n".join([*lines, "", *notes(result), ""])


_HEAD: Final = (
    *("Model", "Size px", "Precision", "Threads", "Batch", "Multiply-adds G", "p50 ms", "p90 ms"),
    *("p99 ms", "FPS", "Load ms", "Memory MiB", "Share of peak", "Box AP", "Diameter mm"),
)


def _cells(row: Record) -> list[str]:
    accuracy = row.get("accuracy") or {}
    return [
        row["name"],
        size_text(row),
        row["precision"],
        str(row["threads"]),
        str(row["batch"]),
        f"{row['graph_multiply_adds'] / _GIGA:.2f}",
        *(f"{row[key]:.1f}" for key in ("p50_ms", "p90_ms", "p99_ms", "fps")),
        f"{row['load_ms']:.0f}",
        number_text(row["peak_memory_mib"], 0),
        share_text(row["share_of_peak"]),
        number_text(accuracy.get("box_ap"), 1),
        number_text(accuracy.get("diameter_error_mm"), 0),
    ]


def notes(result: Record) -> Iterator[str]:
    """Lines that say where, when and how a result was measured."""
    environment, method = result["environment"], result["method"]
    if told := verdict(result, [row_label(row) for row in result["rows"]]):
        yield told
    yield (
        f"{machine_words(environment['processor'], environment['usable_cores'])}, onnxruntime"
        f" {environment['onnxruntime']}, {environment['date']}. Median of {method['rounds']} rounds"
        f" of {method['duration_s']:g} s in turn, each in its own process, on"
        f" {method['frames']}."
    )
    for count, peak in result["peak"].items():
        found = ", ".join(
            f"{kind} {value:.0f}" for kind, value in peak.items() if value is not None
        )
        yield (
            f"Peak of this machine with {counted(count, 'thread')}, 10^9 multiply-adds a"
            f" second: {found}."
        )
    sources = {
        f"{row['accuracy']['source']} ({row['accuracy']['frames']})"
        for row in result["rows"]
        if row.get("accuracy")
    }
    if sources:
        yield f"AP and median error of the diameter: {'; '.join(sorted(sources))}."
