"""A result of `edgetree bench` as one HTML page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any, Final

from basetree.counts import counted
from basetree.page import parts
from edgetree.bench.cells import number_text
from edgetree.bench.page_charts import front_chart, heat_chart, histogram_chart, stages_chart
from edgetree.bench.result import notes, row_label, size_text
from edgetree.bench.winner import fastest_rows, frame_ms

_NAMES: Final = ("model", "threads", "precision", "batch", "size px")
_SPEED: Final = (
    *(*_NAMES[:2], "p50 ms", "FPS", "box AP", "diameter error mm", "p90 ms", "p99 ms", "mask AP"),
    *("keypoint AP", *_NAMES[2:]),
)
_COST: Final = (
    *(*_NAMES[:2], "memory MiB", "file MB", "load ms", "multiply-adds G", "parameters M"),
    *("share of peak", "J a frame", "provider", *_NAMES[2:]),
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
    yield parts.start("edgetree bench") + "<h1>Speed of tree detectors</h1>"
    yield "".join(parts.note(escape(line)) for line in notes(result))
    yield parts.tiles(_tiles(result))
    if points := list(_front_points(rows)):
        yield parts.heading("Accuracy and speed") + parts.grid([front_chart(points)], "halves")
    yield parts.heading("Speed and accuracy") + parts.table(_SPEED, map(_speed_cells, rows))
    yield parts.heading("Cost", "FLOPs are twice the multiply-adds.")
    yield parts.table(_COST, map(_cost_cells, rows))
    yield parts.heading("Where the time goes")
    yield "<p>Reading the file, preparing the picture, the parts of the network, reading its "
    yield "outputs, and measuring in metres; one frame at a time. Bars show shares of the time.</p>"
    single = [row for row in rows if row["batch"] == min(other["batch"] for other in rows)]
    yield parts.card("", stages_chart([(row_label(row), row["stages_ms"]) for row in single]))
    yield parts.heading("Operators") + "".join(_operators(row) for row in single)
    yield parts.heading("How the times vary")
    yield parts.grid(histogram_chart(row_label(row), row["histogram"]) for row in rows)
    hot = [row for row in rows if row.get("heat")]
    if hot:
        yield parts.heading("A long run")
        yield parts.grid(heat_chart(row_label(row), row["heat"]) for row in hot)
    compared = [row for row in rows if row["paper"]]
    if compared:
        yield parts.heading("Beside the paper") + "<p>Grondin et al. (2022) count parameters and "
        yield "multiply-adds of the backbone as classifier of 224x224 px; AP is on its own "
        yield f"simulated frames, speed on an {escape(result['paper_gpu'])}.</p>"
        yield parts.table(_PAPER, map(_paper_cells, compared))
    yield parts.end()


def _front_points(rows: Sequence[Record]) -> Iterator[tuple[str, float, float]]:
    """Name, time in ms and average precision of each model that has one."""
    several = len({row["threads"] for row in rows}) > 1
    for row in rows:
        ap = (row.get("accuracy") or {}).get("box_ap")
        if row["batch"] == 1 and ap is not None:
            threads = f", {counted(row['threads'], 'thread')}" if several else ""
            yield f"{row['name']}{threads}", row["p50_ms"], ap


def _tiles(result: Record) -> Iterator[tuple[str, str]]:
    rows, fastest = result["rows"], fastest_rows(result)
    if len(fastest) == 1:
        yield f"{frame_ms(fastest[0]):.1f} ms", f"fastest: {row_label(fastest[0])}"
    elif fastest:
        yield f"{min(map(frame_ms, fastest)):.1f} ms", f"{len(fastest)} variants, equally fast"
    else:
        yield "–", "no fastest variant: the machine was busy with other work"
    yield f"{max(row['fps'] for row in rows):.1f}", "most frames a second"
    yield str(len(rows)), "variants measured in turn"


def _names(row: Record) -> list[str]:
    return [row["name"], str(row["threads"]), row["precision"], str(row["batch"]), size_text(row)]


def _speed_cells(row: Record) -> list[str]:
    accuracy = row.get("accuracy") or {}
    name, threads, *others = _names(row)
    return [
        name,
        threads,
        *(f"{row[key]:.2f}" for key in ("p50_ms", "fps")),
        *(_number(accuracy.get(key), 1) for key in ("box_ap", "diameter_error_mm")),
        *(f"{row[key]:.2f}" for key in ("p90_ms", "p99_ms")),
        *(_number(accuracy.get(key), 1) for key in ("mask_ap", "keypoint_ap")),
        *others,
    ]


def _cost_cells(row: Record) -> list[str]:
    share = row["share_of_peak"]
    name, threads, *others = _names(row)
    return [
        name,
        threads,
        _number(row["peak_memory_mib"], 0),
        f"{row['file_bytes'] / 1e6:.1f}",
        f"{row['load_ms']:.0f}",
        f"{row['graph_multiply_adds'] / 1e9:.2f}",
        _number(row["parameters"] and row["parameters"] / 1e6, 2),
        "-" if share is None else f"{100 * share:.0f} %",
        _number(row["energy_j_per_frame"], 3),
        row["provider"],
        *others,
    ]


def _paper_cells(row: Record) -> list[str]:
    paper, classifier = row["paper"], row["classifier"] or {}
    accuracy = row.get("accuracy") or {}
    return [
        row["name"],
        number_text(classifier.get("parameters"), 1, 1e6),
        _number(paper["parameters"] / 1e6, 1),
        number_text(classifier.get("multiply_adds"), 2, 1e9),
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
    return f"<details><summary>{escape(row_label(row))}</summary>{content}</details>"
