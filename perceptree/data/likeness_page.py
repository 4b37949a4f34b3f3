"""HTML report of the comparison of real and simulated images."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import numpy as np

from basetree.arrays import Float
from basetree.page import charts, parts
from basetree.page.axis import Axis
from perceptree.data.likeness import Comparison, Difference, read_small
from perceptree.drawing import fitted

_EXAMPLES = 12
_EXAMPLE_PX = 320
_SPAN_PX, _ROW_PX = 420, 15
_CLEAR_SEPARATION = 0.5
_SETS = ("real", "simulated")
_JPEG_QUALITY = 80


def likeness_page(comparison: Comparison) -> str:
    """Render the comparison as a self-contained HTML page with example images."""
    separating = sum(d.separation > _CLEAR_SEPARATION for d in comparison.differences)
    head = parts.tiles(
        [
            (f"{len(comparison.real):,}", "real images"),
            (f"{len(comparison.simulated):,}", "simulated images"),
            (f"{separating}", f"of {len(comparison.differences)} measures separate them clearly"),
        ]
    )
    note = (
        "Bars span half of the images, lines 90 %, the tick is the median. Separation is how"
        " reliably a measure alone separates real from simulated images: 0 is chance, 1 is always."
        " Shift is the simulated median minus the real median, in standard deviations of the real"
        " images. Images are compared at a width of 640 px. With few real images the numbers are"
        " uncertain."
    )
    title = "Real and simulated images"
    return parts.whole(
        title,
        f"<h1>{title}</h1>{head}",
        parts.heading("Differences", note),
        parts.card("", _table(comparison.differences)),
        parts.heading("Examples"),
        _examples(comparison),
    )


def _table(differences: Sequence[Difference]) -> str:
    heads = ("measure", "distributions", "separation", "shift", "real median", "simulated median")
    rows: Iterable[parts.Cells] = (
        [
            d.measure.title,
            parts.Cell(_box_plots(d)),
            parts.share_cell(f"{d.separation:.2f}", 100 * d.separation),
            f"{d.shift:+.1f}",
            f"{np.median(d.real):.3g}",
            f"{np.median(d.simulated):.3g}",
        ]
        for d in differences
    )
    return charts.legend(enumerate(_SETS)) + parts.table(heads, rows)


def _box_plots(difference: Difference) -> str:
    """Draw the two box plots of a measure on one axis."""
    sets = (difference.real, difference.simulated)
    low, high = np.percentile(np.concatenate(sets), (1, 99))
    axis = Axis(float(low), max(float(high), float(low) + 1e-9))
    drawn = "".join(
        charts.series(number, _box_plot(values, axis, number * _ROW_PX))
        for number, values in enumerate(sets)
    )
    return (
        f'<svg viewBox="0 0 {_SPAN_PX} {2 * _ROW_PX}" style="width:{_SPAN_PX}px" role="img"'
        f' aria-label="{escape(difference.measure.title)}">{drawn}</svg>'
    )


def _box_plot(values: Float, axis: Axis, top: float) -> str:
    first, left, middle, right, last = (
        4 + axis.place(value) * (_SPAN_PX - 8)
        for value in np.percentile(values, (5, 25, 50, 75, 95)).tolist()
    )
    y = top + _ROW_PX / 2
    return (
        f'<path class="line" d="M{first:.1f} {y}H{last:.1f}M{middle:.1f} {y - 6}v12"/>'
        f'<rect x="{left:.1f}" y="{y - 4}" width="{max(right - left, 1):.1f}" height="8"'
        ' opacity=".6"/>'
    )


def _examples(comparison: Comparison) -> str:
    columns = []
    for title, paths in (("Real", comparison.real), ("Simulated", comparison.simulated)):
        indices = np.unique(np.linspace(0, len(paths) - 1, _EXAMPLES).round().astype(int))
        columns.append(
            parts.card(title, parts.grid((_figure(paths[index]) for index in indices), "small"))
        )
    return parts.grid(columns, "halves")


def _figure(path: Path) -> str:
    small = parts.jpeg_of(fitted(read_small(path), _EXAMPLE_PX), _JPEG_QUALITY)
    return parts.figure(small, escape(path.name), path.name)
