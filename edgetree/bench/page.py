"""A result of `edgetree bench` as one HTML page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any, Final

from basetree.counts import counted
from basetree.page import parts
from edgetree.bench.page_charts import front_chart, heat_chart, histogram_chart, stages_chart
from edgetree.bench.result import notes, size_text

_COLUMNS: Final = (
    *("model", "size px", "precision", "provider", "threads", "batch", "multiply-adds G"),
    *("FLOPs G", "parameters M", "file MB", "load ms", "p50 ms", "p90 ms", "p99 ms", "FPS"),
    *("memory MiB", "share of peak", "J a frame", "box AP", "mask AP", "keypoint AP"),
    "diameter error mm",
)
_PAPER: Final = (
    *("network", "classifier: parameters M", "paper", "multiply-adds G", "paper", "FPS here"),
    *("FPS, paper's GPU", "box AP here", "paper"),
)
_OPERATORS: Final = 8

Record = Mapping[str, Any]


def page_html(result: Record) -> Iterator[str]:
    """The page in parts; it needs no network and no script."""
    rows = result["rows"]
    fastest = min(rows, key=lambda row: row["p50_ms"] / row["batch"])
    yield parts.start("edgetree bench") + "<h1>Speed of tree detectors</h1>"
    yield "".join(parts.note(escape(line)) for line in notes(result))
    yield parts.tiles(
        [
            (f"{fastest['p50_ms'] / fastest['batch']:.1f} ms", f"fastest: {_label(fastest)}"),
            (f"{max(row['fps'] for row in rows):.1f}", "most frames a second"),
            (str(len(rows)), "variants measured in turn"),
        ]
    )
    if points := list(_front_points(rows)):
        yield parts.heading("Accuracy and speed") + parts.grid([front_chart(points)], "halves")
    yield parts.heading("All figures") + parts.table(_COLUMNS, map(_cells, rows))
    yield parts.heading("Where the time goes")
    yield "<p>Reading the file, preparing the picture, the parts of the network, reading its "
    yield "outputs, and measuring in metres; one frame at a time. Bars show shares of the time.</p>"
    single = [row for row in rows if row["batch"] == min(other["batch"] for other in rows)]
    yield parts.card("", stages_chart([(_label(row), row["stages_ms"]) for row in single]))
    yield parts.heading("Operators") + "".join(_operators(row) for row in single)
    yield parts.heading("How the times vary")
    yield parts.grid(histogram_chart(_label(row), row["histogram"]) for row in rows)
    hot = [row for row in rows if row.get("heat")]
    if hot:
        yield parts.heading("A long run")
        yield parts.grid(heat_chart(_label(row), row["heat"]) for row in hot)
    compared = [row for row in rows if row["paper"]]
    if compared:
        yield parts.heading("Beside the paper") + "<p>Grondin et al. (2022) count parameters and "
        yield "multiply-adds of the backbone as classifier of 224x224 px; AP is on its own "
        yield f"simulated frames, speed on an {escape(result['paper_gpu'])}.</p>"
        yield parts.table(_PAPER, map(_paper_cells, compared))
    yield parts.end()


def _label(row: Record) -> str:
    text = f"{row['name']} {row['precision']} {size_text(row)}, {counted(row['threads'], 'thread')}"
    return text if row["batch"] == 1 else f"{text}, batch {row['batch']}"


def _front_points(rows: Sequence[Record]) -> Iterator[tuple[str, float, float]]:
    """Name, time in ms and average precision of each model that has one."""
    several = len({row["threads"] for row in rows}) > 1
    for row in rows:
        ap = (row.get("accuracy") or {}).get("box_ap")
        if row["batch"] == 1 and ap is not None:
            threads = f", {counted(row['threads'], 'thread')}" if several else ""
            yield f"{row['name']}{threads}", row["p50_ms"], ap


def _cells(row: Record) -> list[str]:
    accuracy = row.get("accuracy") or {}
    share = row["share_of_peak"]
    return [
        row["name"],
        size_text(row),
        row["precision"],
        row["provider"],
        str(row["threads"]),
        str(row["batch"]),
        f"{row['graph_multiply_adds'] / 1e9:.2f}",
        f"{row['graph_flops'] / 1e9:.2f}",
        _number(row["parameters"] and row["parameters"] / 1e6, 2),
        f"{row['file_bytes'] / 1e6:.1f}",
        f"{row['load_ms']:.0f}",
        *(f"{row[key]:.2f}" for key in ("p50_ms", "p90_ms", "p99_ms", "fps")),
        _number(row["peak_memory_mib"], 0),
        "-" if share is None else f"{100 * share:.0f} %",
        _number(row["energy_j_per_frame"], 3),
        *(_number(accuracy.get(key), 1) for key in ("box_ap", "mask_ap", "keypoint_ap")),
        _number(accuracy.get("diameter_error_mm"), 1),
    ]


def _paper_cells(row: Record) -> list[str]:
    paper, classifier = row["paper"], row["classifier"] or {}
    accuracy = row.get("accuracy") or {}
    return [
        row["name"],
        _number(classifier.get("parameters", 0) / 1e6, 1),
        _number(paper["parameters"] / 1e6, 1),
        _number(classifier.get("multiply_adds", 0) / 1e9, 2),
        _number(paper["multiply_adds"] / 1e9, 2),
        f"{row['fps']:.2f}",
        f"{paper['fps']:.0f}",
        _number(accuracy.get("box_ap"), 1),
        _number(paper["box_ap"].get(row["modality"]), 1),
    ]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _operators(row: Record) -> str:
    total_ms = sum(each["ms"] for each in row["operators"])
    rows = (
        [
            each["operator"],
            each["provider"],
            str(each["nodes"]),
            f"{each['ms']:.2f}",
            f"{100 * each['ms'] / total_ms:.0f} %",
        ]
        for each in row["operators"][:_OPERATORS]
    )
    content = parts.table(("operator", "runs on", "nodes", "ms", "share"), rows)
    return f"<details><summary>{escape(_label(row))}</summary>{content}</details>"
