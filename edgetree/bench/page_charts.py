"""Charts of the benchmark's page, each as a card."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from basetree.page import charts, parts
from basetree.page.axis import Axis
from edgetree.bench.stages import STAGES

_SIZE_PX: Final = (380, 240)
_FRONT_PX: Final = (560, 300)
_STAGES_WIDTH_PX: Final = 920
_RATIO: Final = 4  # of the longest to the shortest time from which on their axis is logarithmic

Record = Mapping[str, Any]


def front_chart(points: Sequence[tuple[str, float, float]]) -> str:
    """Average precision of boxes over the time of a frame, from (name, ms, AP) of each model.

    The line joins the models that no other one beats in both.
    """
    best: list[tuple[float, float]] = []
    for _, ms, ap in sorted(points, key=lambda each: (each[1], -each[2])):
        if not best or ap > best[-1][1]:
            best.append((ms, ap))
    times_ms, aps = [ms for _, ms, _ in points], [ap for *_, ap in points]
    across = Axis.logarithmic if max(times_ms) > _RATIO * min(times_ms) else Axis.rounded
    plot = charts.Plot(
        across(min(times_ms), max(times_ms), "ms of a frame"),
        Axis.rounded(min(aps) - 1, max(aps) + 1, "box AP, %"),
        _FRONT_PX,
    )
    marks = plot.named_dots(
        (ms, ap, f"{name}: {ms:.1f} ms, {ap:.1f} AP", name) for name, ms, ap in points
    )
    name = "Box AP and time of a frame"
    return parts.card(name, plot.svg(name, charts.series(0, plot.line(best), *marks)))


def histogram_chart(name: str, histogram: Record) -> str:
    """How many frames took how long; the last bar holds the slowest hundredth too."""
    edges, counts = histogram["edges_ms"], histogram["counts"]
    plot = charts.Plot(
        Axis.rounded(edges[0], edges[-1], "ms of a call"),
        Axis.rounded(0, max(counts), "calls", whole=True),
        _SIZE_PX,
    )
    hints = [
        f"{left:.2f} to {right:.2f} ms: {count}"
        for left, right, count in zip(edges[:-1], edges[1:], counts, strict=True)
    ]
    return parts.card(name, plot.svg(name, charts.series(0, plot.bars(edges, counts, hints))))


def heat_chart(name: str, points: Sequence[Record]) -> str:
    """Median (line) and 99th percentile (dots) of the times of a long run, over its minutes."""
    plot = charts.Plot(
        Axis.rounded(0, points[-1]["minute"], "minutes"),
        Axis.rounded(0, max(point["p99_ms"] for point in points), "ms, dots: p99"),
        _SIZE_PX,
    )
    median = plot.line((point["minute"], point["p50_ms"]) for point in points)
    dots = (
        plot.dot(
            point["minute"],
            point["p99_ms"],
            f"minute {point['minute']:.1f}: {point['p99_ms']:.1f} ms",
        )
        for point in points
    )
    return parts.card(name, plot.svg(name, charts.series(0, median), charts.series(1, *dots)))


def stages_chart(rows: Sequence[tuple[str, Record]]) -> str:
    """Where the time of a frame goes: one bar for each model, from (name, times of the stages).

    All bars have the same width, as fast and slow models would not fit one scale.
    """
    bars = []
    for name, stages in rows:
        times_ms = {stage: stages[stage] or 0.0 for stage in STAGES}
        parts = [charts.Part(ms, stage, f"{stage}: {ms:.2f} ms") for stage, ms in times_ms.items()]
        bars.append((f"{name}: {sum(times_ms.values()):.1f} ms", parts))
    chart = charts.stacked_bars("stages", bars, _STAGES_WIDTH_PX)
    names = " ".join(f"{charts.key(f'part{n}', '■')} {name}" for n, name in enumerate(STAGES))
    return f'<div class="scroll">{chart}</div><p class="note">{names}</p>'
