"""Charts as SVG, without a plotting library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Final, NamedTuple

__all__ = ["Bars", "bar_chart", "nice_axis"]

_WIDTH, _LEFT, _BOTTOM, _TOP, _PLOT_HEIGHT = 300, 38, 22, 24, 150
_PLOT_WIDTH: Final = _WIDTH - _LEFT - 18
_MAX_LABELS: Final = 8


class Bars(NamedTuple):
    """The counts of one series, and how many of each count are marked."""

    counts: Sequence[int]
    marked: Sequence[int]


def nice_axis(largest: float, *, whole: bool = False) -> tuple[float, float]:
    """(end, step) of an axis from zero to at least `largest`, with up to ten round steps.

    With `whole`, the step is a whole number.
    """
    rough = max(largest, 1e-6) / 5.0
    magnitude = 10.0 ** math.floor(math.log10(rough))
    step = magnitude * min((m for m in (1, 2, 5, 10) if m * magnitude >= rough), default=10)
    if whole:
        step = max(step, 1.0)
    return step * math.ceil(largest / step + 1e-9), step


def bar_chart(
    name: str, edges_html: Sequence[str], series: Sequence[Bars], *, unit_html: str = ""
) -> str:
    """A histogram: the bars of all series side by side, the marked part of each at its bottom.

    Args:
        name: what is counted.
        edges_html: SVG `text` content for the edges of the bins, one more than there are bins.
        series: the counts of each series, one count per bin.
        unit_html: unit of the edges, as `tspan` content behind the name.

    Returns:
        The SVG element.
    """
    bottom = _TOP + _PLOT_HEIGHT
    highest = max((count for bars in series for count in bars.counts), default=0)
    top, step = nice_axis(max(highest, 1), whole=True)
    scale = _PLOT_HEIGHT / top
    lines = "".join(
        _grid_line(index * step, bottom - index * step * scale)
        for index in range(round(top / step) + 1)
    )
    width = _PLOT_WIDTH / (len(edges_html) - 1)
    every = math.ceil(len(edges_html) / _MAX_LABELS)
    edges = "".join(
        f'<text x="{_LEFT + index * width:.1f}" y="{bottom + 15}" text-anchor="middle">{text}'
        "</text>"
        for index, text in enumerate(edges_html)
        if index % every == 0
    )
    drawn = "".join(
        f'<g class="{"first" if index == 0 else "second"}">'
        + _series(bars, index, len(series), width, scale)
        + "</g>"
        for index, bars in enumerate(series)
    )
    unit = f", <tspan>{unit_html}</tspan>" if unit_html else ""
    return (
        f'<svg viewBox="0 0 {_WIDTH} {bottom + _BOTTOM}" role="img" aria-label="{escape(name)}">'
        f'<text class="name" x="{_LEFT}" y="13">{escape(name)}{unit}</text>'
        f'<text x="{_LEFT + _PLOT_WIDTH}" y="13" text-anchor="end">↑ trees</text>'
        f"{lines}{edges}{drawn}</svg>"
    )


def _grid_line(count: float, y: float) -> str:
    return (
        f'<path class="axis" d="M{_LEFT} {y:.1f}H{_LEFT + _PLOT_WIDTH}"/>'
        f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{count:g}</text>'
    )


def _series(bars: Bars, number: int, count: int, width: float, scale: float) -> str:
    """The bars of one of `count` series, which stand side by side in each bin."""
    bar_width = (width - 2) / count
    drawn = []
    for index, (trees, marked) in enumerate(zip(bars.counts, bars.marked, strict=True)):
        x = _LEFT + index * width + 1 + number * bar_width
        if trees:
            drawn.append(_bar("", x, bar_width, trees, scale, f"trees: {trees}"))
        if marked:
            drawn.append(
                _bar(' class="gross"', x, bar_width, marked, scale, f"gross errors: {marked}")
            )
    return "".join(drawn)


def _bar(attribute: str, x: float, width: float, count: int, scale: float, hint: str) -> str:
    height = count * scale
    return (
        f'<rect{attribute} x="{x:.1f}" y="{_TOP + _PLOT_HEIGHT - height:.1f}"'
        f' width="{max(width - 1, 1):.1f}" height="{height:.1f}"><title>{hint}</title></rect>'
    )
