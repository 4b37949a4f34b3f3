"""Small charts as inline SVG, made without a plotting library; colours are set by the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

_WIDTH, _HEIGHT = 340, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 36, 18, 10, 30
_ROW, _NAME_WIDTH, _VALUE_WIDTH = 24, 104, 84
_MAX_LABELS = 9


def histogram_svg(name: str, edges: Sequence[float], counts: Sequence[int], unit: str = "") -> str:
    """Draw a histogram.

    Args:
        name: Name of the chart.
        edges: Edges of the bins, one more than counts.
        counts: Counts of the bins.
        unit: Unit in the tooltips.
    """
    total = max(1, sum(counts))
    ticks = [_number(edge) for edge in edges]
    bars = [
        (f"{ticks[n]} to {ticks[n + 1]}{unit}", count / total, count)
        for n, count in enumerate(counts)
    ]
    step = (_WIDTH - _LEFT - _RIGHT) / max(1, len(counts))
    every = math.ceil(len(edges) / _MAX_LABELS)
    labels = [(_LEFT + n * step, tick) for n, tick in enumerate(ticks) if n % every == 0]
    return _columns(name, bars, labels)


def counts_svg(name: str, counts: Sequence[int]) -> str:
    """Draw a bar for each of the numbers 0, 1, 2 and so on, with their counts."""
    total = max(1, sum(counts))
    bars = [(str(number), count / total, count) for number, count in enumerate(counts)]
    step = (_WIDTH - _LEFT - _RIGHT) / max(1, len(counts))
    every = math.ceil(len(counts) / (2 * _MAX_LABELS))
    labels = [(_LEFT + (n + 0.5) * step, str(n)) for n in range(0, len(counts), every)]
    return _columns(name, bars, labels)


def bars_svg(name: str, parts: Mapping[str, int]) -> str:
    """Draw horizontal bars of named counts, with their percentages."""
    total, most = max(1, sum(parts.values())), max(1, *parts.values(), 1)
    span = _WIDTH - _NAME_WIDTH - _VALUE_WIDTH
    rows = []
    for number, (part, count) in enumerate(parts.items()):
        y = number * _ROW
        rows.append(
            f'<text x="{_NAME_WIDTH - 8}" y="{y + 16}" text-anchor="end">{escape(part)}</text>'
            f'<rect class="bar" x="{_NAME_WIDTH}" y="{y + 4}" height="{_ROW - 8}" rx="2"'
            f' width="{span * count / most:.1f}"/>'
            f'<text x="{_NAME_WIDTH + span * count / most + 6:.1f}" y="{y + 16}">{count:,}'
            f" · {100 * count / total:.0f} %</text>"
        )
    return _svg(name, _ROW * len(parts), "".join(rows))


def stacked_svg(name: str, rows: Mapping[str, Mapping[str, int]]) -> str:
    """Draw a horizontal bar per row, divided by the percentages of its parts."""
    span, drawn = _WIDTH - _NAME_WIDTH - 8, []
    for number, (row, parts) in enumerate(rows.items()):
        y, x, total = number * _ROW, float(_NAME_WIDTH), max(1, sum(parts.values()))
        drawn.append(
            f'<text x="{_NAME_WIDTH - 8}" y="{y + 16}" text-anchor="end">{escape(row)}</text>'
        )
        for index, (part, count) in enumerate(parts.items()):
            width, share = span * count / total, f"{100 * count / total:.0f} %"
            drawn.append(
                f'<rect class="part{index}" x="{x:.1f}" y="{y + 4}" width="{width:.1f}"'
                f' height="{_ROW - 8}"><title>{escape(part)}: {count:,}, {share}</title></rect>'
            )
            if width > 34:
                drawn.append(
                    f'<text class="on{index}" x="{x + width / 2:.1f}" y="{y + 16}"'
                    f' text-anchor="middle">{share}</text>'
                )
            x += width
    return _svg(name, _ROW * len(rows), "".join(drawn))


def _columns(
    name: str, bars: Sequence[tuple[str, float, int]], labels: Sequence[tuple[float, str]]
) -> str:
    """Vertical bars (label, fraction, count) on a percent axis, with labels (x, text) below."""
    top, step = _percent_axis(max((share for _, share, _ in bars), default=0.0))
    height, bottom = _HEIGHT - _TOP - _BOTTOM, _HEIGHT - _BOTTOM
    parts = []
    for number in range(round(top / step) + 1):
        y = bottom - height * number * step / top
        parts.append(
            f'<path class="axis" d="M{_LEFT} {y:.1f}H{_WIDTH - _RIGHT}"/>'
            f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">'
            f"{100 * number * step:g} %</text>"
        )
    width = (_WIDTH - _LEFT - _RIGHT) / max(1, len(bars))
    for number, (label, share, count) in enumerate(bars):
        tall = height * share / top
        parts.append(
            f'<rect class="bar" x="{_LEFT + number * width + 1:.1f}" y="{bottom - tall:.1f}"'
            f' width="{max(1.0, width - 2):.1f}" height="{tall:.1f}">'
            f"<title>{escape(label)}: {count:,}, {100 * share:.1f} %</title></rect>"
        )
    parts += [
        f'<text x="{x:.1f}" y="{bottom + 16}" text-anchor="middle">{escape(text)}</text>'
        for x, text in labels
    ]
    return _svg(name, _HEIGHT, "".join(parts))


def _svg(name: str, height: float, content: str) -> str:
    return (
        f'<svg viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="{escape(name)}">'
        f"{content}</svg>"
    )


def _percent_axis(largest: float) -> tuple[float, float]:
    """End and step of an axis from zero to above ``largest``, with round steps."""
    steps = (0.01, 0.02, 0.05, 0.1, 0.2)
    step = next((step for step in steps if step * 5 >= largest), 0.25)
    return step * max(1, math.ceil(largest / step - 1e-9)), step


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
