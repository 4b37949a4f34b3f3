"""HTML report of the comparison of real and simulated images."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

import cv2
import numpy as np

from perceptree.arrays import Float
from perceptree.data.likeness import Comparison, Difference, read_small
from perceptree.page import card, render_page, tiles

_EXAMPLES = 12
_EXAMPLE_PX = 320
_SPAN_PX, _ROW_PX = 420, 15
_CLEAR_SEPARATION = 0.5
_COLOURS = {"real": "var(--accent)", "simulated": "#e08a2e"}


def likeness_page(comparison: Comparison) -> str:
    """Render the comparison as a self-contained HTML page with example images."""
    separating = sum(d.separation > _CLEAR_SEPARATION for d in comparison.differences)
    head = tiles(
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
    return render_page(
        "Real and simulated images",
        "<h1>Real and simulated images</h1>"
        + head
        + f'<h2>Differences</h2><p class="note">{note}</p>'
        + _table(comparison.differences)
        + "<h2>Examples</h2>"
        + _examples(comparison),
    )


def _table(differences: Sequence[Difference]) -> str:
    rows = "".join(
        f"<tr><td>{escape(d.measure.title)}</td><td>{_box_plots(d)}</td>"
        f'<td style="--share:{100 * d.separation:.0f}%">{d.separation:.2f}</td>'
        f"<td>{d.shift:+.1f}</td><td>{np.median(d.real):.3g}</td>"
        f"<td>{np.median(d.simulated):.3g}</td></tr>"
        for d in differences
    )
    legend = " ".join(
        f'<span class="dot" style="background:{colour}"></span>{name}'
        for name, colour in _COLOURS.items()
    )
    return (
        f'<div class="card scroll"><p class="note">{legend}</p><table class="shares"><thead><tr>'
        "<th>measure</th><th>distributions</th><th>separation</th><th>shift</th>"
        f"<th>real median</th><th>simulated median</th></tr></thead><tbody>{rows}</tbody></table>"
        "</div>"
    )


def _box_plots(difference: Difference) -> str:
    """Draw the two box plots of a measure on one axis."""
    both = np.concatenate([difference.real, difference.simulated])
    low, high = np.percentile(both, (1, 99))
    scale = (_SPAN_PX - 8) / max(float(high - low), 1e-9)
    drawn = ""
    for row, (name, values) in enumerate(
        (("real", difference.real), ("simulated", difference.simulated))
    ):
        drawn += _box_plot(values, float(low), scale, row * _ROW_PX, _COLOURS[name])
    return (
        f'<svg viewBox="0 0 {_SPAN_PX} {2 * _ROW_PX}" style="width:{_SPAN_PX}px" role="img"'
        f' aria-label="{escape(difference.measure.title)}">{drawn}</svg>'
    )


def _box_plot(values: Float, low: float, scale: float, top: float, colour: str) -> str:
    quantiles = np.percentile(values, (5, 25, 50, 75, 95))
    first, left, middle, right, last = np.clip(4 + (quantiles - low) * scale, 2, _SPAN_PX - 2)
    y = top + _ROW_PX / 2
    return (
        f'<line x1="{first:.1f}" x2="{last:.1f}" y1="{y}" y2="{y}" stroke="{colour}"/>'
        f'<rect x="{left:.1f}" y="{y - 4}" width="{max(right - left, 1):.1f}" height="8"'
        f' fill="{colour}" opacity=".55"/>'
        f'<line x1="{middle:.1f}" x2="{middle:.1f}" y1="{y - 6}" y2="{y + 6}" stroke="{colour}"'
        ' stroke-width="3"/>'
    )


def _examples(comparison: Comparison) -> str:
    columns = []
    for title, paths in (("Real", comparison.real), ("Simulated", comparison.simulated)):
        indices = np.unique(np.linspace(0, len(paths) - 1, _EXAMPLES).round().astype(int))
        shown = "".join(_figure(paths[index]) for index in indices)
        columns.append(card(title, f'<div class="gallery">{shown}</div>'))
    return f'<div class="grid halves">{"".join(columns)}</div>'


def _figure(path: Path) -> str:
    image = read_small(path)
    height = round(image.shape[0] * _EXAMPLE_PX / image.shape[1])
    small = cv2.resize(image, (_EXAMPLE_PX, height), interpolation=cv2.INTER_AREA)
    data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
    encoded = base64.b64encode(data).decode("ascii")
    return (
        f'<figure><img src="data:image/jpeg;base64,{encoded}" width="{_EXAMPLE_PX}"'
        f' height="{height}" alt="{escape(path.name)}"><figcaption>{escape(path.name)}'
        "</figcaption></figure>"
    )
