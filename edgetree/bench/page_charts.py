"""Charts of the benchmark's page, as SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, Final

from edgetree.bench.stages import STAGES
from edgetree.report.charts import nice_axis

__all__ = ["front_chart", "heat_chart", "histogram_chart", "stages_chart"]

_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM = 460, 44, 24, 24, 34
_PLOT_WIDTH: Final = _WIDTH - _LEFT - _RIGHT
_PLOT_HEIGHT: Final = 190
_HEIGHT: Final = _TOP + _PLOT_HEIGHT + _BOTTOM
_BAR: Final = 22
_SHORTEST_LABELLED_PX: Final = 34

Record = Mapping[str, Any]
Point = tuple[float, float]


def front_chart(points: Sequence[tuple[str, float, float]]) -> str:
    """Average precision of boxes over the time of a frame, from (name, ms, AP) of each model.

    The line joins the models that no other one beats in both.
    """
    best: list[Point] = []
    for _, ms, ap in sorted(points, key=lambda each: (each[1], -each[2])):
        if not best or ap > best[-1][1]:
            best.append((ms, ap))
    axes = _Axes(max(ms for _, ms, _ in points), max(ap for *_, ap in points))
    marks = "".join(
        f'<circle cx="{axes.x(ms):.1f}" cy="{axes.y(ap):.1f}" r="4.5"><title>{escape(name)}: '
        f"{ms:.1f} ms, {ap:.1f} AP</title></circle>"
        f'<text x="{axes.x(ms) - 8:.1f}" y="{axes.y(ap) + 15:.1f}" text-anchor="end">'
        f"{escape(name)}</text>"
        for name, ms, ap in points
    )
    drawn = f'<g class="first">{axes.line(best)}{marks}</g>'
    return axes.svg("Accuracy and speed", "ms of a frame →", "↑ box AP, %", drawn)


def histogram_chart(name: str, histogram: Record) -> str:
    """How many frames took how long; the last bar holds the slowest hundredth too."""
    edges, counts = histogram["edges_ms"], histogram["counts"]
    low, high = edges[0], edges[-1]
    axes = _Axes(high - low, max(max(counts), 1), offset=low, whole=True)
    bars = "".join(
        f'<rect x="{axes.x(left):.1f}" y="{axes.y(count):.1f}"'
        f' width="{max(axes.x(right) - axes.x(left) - 1, 1):.1f}"'
        f' height="{axes.y(0) - axes.y(count):.1f}">'
        f"<title>{left:.2f} to {right:.2f} ms: {count}</title></rect>"
        for left, right, count in zip(edges[:-1], edges[1:], counts, strict=True)
        if count
    )
    return axes.svg(name, "ms of a call →", "↑ calls", f'<g class="first">{bars}</g>')


def heat_chart(name: str, points: Sequence[Record]) -> str:
    """Median (line) and 99th percentile (dots) of the times of a long run, over its minutes."""
    axes = _Axes(points[-1]["minute"], max(point["p99_ms"] for point in points))
    median = axes.line([(point["minute"], point["p50_ms"]) for point in points])
    dots = "".join(
        f'<circle cx="{axes.x(point["minute"]):.1f}" cy="{axes.y(point["p99_ms"]):.1f}" r="2.2">'
        f"<title>minute {point['minute']:.1f}: {point['p99_ms']:.1f} ms</title></circle>"
        for point in points
    )
    drawn = f'<g class="first">{median}</g><g class="second">{dots}</g>'
    return axes.svg(name, "minutes →", "↑ ms, dots: p99", drawn)


def stages_chart(rows: Sequence[tuple[str, Record]]) -> str:
    """Where the time of a frame goes: one bar for each model, from (name, times of the stages).

    All bars have the same width, as fast and slow models would not fit one scale.
    """
    totals = [sum(value or 0.0 for value in stages.values()) for _, stages in rows]
    drawn = []
    for number, ((name, stages), total) in enumerate(zip(rows, totals, strict=True)):
        top = 20 + number * (_BAR + 26)
        drawn.append(f'<text x="0" y="{top - 5}">{escape(name)}: {total:.1f} ms</text>')
        left = 0.0
        for index, stage in enumerate(STAGES):
            width = (stages[stage] or 0.0) / total * (_WIDTH * 2 - 20)
            drawn.append(_stage(stage, stages[stage], index, (left, top, width)))
            left += width
    height = 20 + len(rows) * (_BAR + 26)
    return (
        f'<svg class="stages" viewBox="0 0 {_WIDTH * 2} {height}" role="img" aria-label="stages">'
        + "".join(drawn)
        + "</svg>"
    )


def _stage(stage: str, ms: float | None, index: int, box: tuple[float, float, float]) -> str:
    left, top, width = box
    if not ms:
        return ""
    label = (
        f'<text class="on-bar" x="{left + width / 2:.1f}" y="{top + _BAR - 7}"'
        f' text-anchor="middle">{stage}</text>'
        if width > max(_SHORTEST_LABELLED_PX, 7 * len(stage))
        else ""
    )
    return (
        f'<rect class="stage stage-{index}" x="{left:.1f}" y="{top}" width="{width:.1f}"'
        f' height="{_BAR}"><title>{stage}: {ms:.2f} ms</title></rect>{label}'
    )


class _Axes:
    """Axes from zero (horizontally from a round number up to `offset`), with round steps."""

    def __init__(
        self, width: float, height: float, offset: float = 0.0, *, whole: bool = False
    ) -> None:
        step = nice_axis(width)[1]
        self._offset = math.floor(offset / step) * step
        self._right, self._x_step = nice_axis(offset + width - self._offset)
        self._top, self._y_step = nice_axis(height, whole=whole)

    def x(self, value: float) -> float:
        """Horizontal position of a value."""
        return _LEFT + (value - self._offset) / self._right * _PLOT_WIDTH

    def y(self, value: float) -> float:
        """Vertical position of a value."""
        return _TOP + _PLOT_HEIGHT * (1.0 - value / self._top)

    def line(self, points: Sequence[Point]) -> str:
        """A line through points."""
        path = " ".join(f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in points)
        return f'<polyline fill="none" points="{path}"/>'

    def svg(self, name: str, below: str, above: str, drawn: str) -> str:
        """The chart with its axes."""
        bottom = _TOP + _PLOT_HEIGHT
        ticks = "".join(
            f'<path class="axis" d="M{_LEFT} {self.y(value):.1f}H{_LEFT + _PLOT_WIDTH}"/>'
            f'<text x="{_LEFT - 6}" y="{self.y(value) + 4:.1f}" text-anchor="end">{value:g}</text>'
            for value in _steps(self._top, self._y_step)
        ) + "".join(
            f'<text x="{self.x(self._offset + value):.1f}" y="{bottom + 15}" text-anchor="middle">'
            f"{self._offset + value:.4g}</text>"
            for value in _steps(self._right, self._x_step)
        )
        return (
            f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{escape(name)}">'
            f'<text class="name" x="{_LEFT}" y="13">{escape(name)}</text>'
            f'<text x="{_LEFT + _PLOT_WIDTH}" y="13" text-anchor="end">{escape(above)}</text>'
            f'<text x="{_LEFT + _PLOT_WIDTH}" y="{_HEIGHT - 4}" text-anchor="end">{escape(below)}'
            f"</text>{ticks}{drawn}</svg>"
        )


def _steps(end: float, step: float) -> list[float]:
    return [index * step for index in range(round(end / step) + 1)]
