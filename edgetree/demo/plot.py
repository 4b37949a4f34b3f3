"""Plots of measured and true values, and of errors, as SVG."""

from __future__ import annotations

import math
from collections.abc import Sequence

from edgetree.demo.result import ModelResult
from edgetree.demo.tables import QUANTITY_STYLES
from edgetree.report.charts import Bars, bar_chart, nice_axis

__all__ = ["error_histogram", "scatter_plot"]

_SIZE, _LEFT, _BOTTOM, _TOP = 300, 38, 34, 24
_SPAN = _SIZE - _LEFT - 10
_BINS_PER_SIDE = 4


def scatter_plot(models: Sequence[ModelResult], quantity: str) -> str:
    """Plot the measured over the true value of each tree, with error bars of one std.

    Both axes have the same scale and start at zero, so perfect measurements lie on the dashed
    diagonal.

    Returns:
        The SVG element; an empty string if nothing was measured.
    """
    style = QUANTITY_STYLES[quantity]
    dots = [_dots(model, quantity) for model in models]
    values_m = [abs(value) for model_dots in dots for dot in model_dots for value in dot[:2]]
    if not values_m:
        return ""
    top, step = nice_axis(max(values_m) * style.per_metre)
    scale = _SPAN / top
    ticks = "".join(_tick(index * step, scale) for index in range(round(top / step) + 1))
    series = "".join(
        f'<g class="{"first" if index == 0 else "second"}">'
        + "".join(_mark(dot, scale * style.per_metre) for dot in model_dots)
        + "</g>"
        for index, model_dots in enumerate(dots)
    )
    name = f"{style.name}, {style.unit}"
    bottom = _TOP + _SPAN
    return (
        f'<svg viewBox="0 0 {_SIZE} {bottom + _BOTTOM}" role="img" aria-label="{name}">'
        f'<text class="name" x="{_LEFT}" y="13">{name}</text>{ticks}'
        f'<line class="ideal" x1="{_LEFT}" y1="{bottom}" x2="{_LEFT + _SPAN}" y2="{_TOP}"/>'
        f'<text x="{_LEFT + _SPAN}" y="{bottom + 30}" text-anchor="end">true →</text>'
        f'<text x="{_LEFT + _SPAN}" y="13" text-anchor="end">↑ measured</text>{series}</svg>'
    )


def _dots(model: ModelResult, quantity: str) -> list[tuple[float, float, float]]:
    """(true, measured, std) in metres of each measured tree."""
    found = []
    for tree in (tree for frame in model.frames for tree in frame.trees):
        estimate = tree.estimate(quantity)
        if estimate is not None:
            found.append((float(getattr(tree.truth, quantity)), estimate.value, estimate.std))
    return found


def _tick(value: float, scale: float) -> str:
    """Grid lines and labels of one value on both axes."""
    x, y = _LEFT + value * scale, _TOP + _SPAN - value * scale
    label = f"{value:g}"
    return (
        f'<path class="axis" d="M{_LEFT} {y:.1f}H{_LEFT + _SPAN}M{x:.1f} {_TOP}V{_TOP + _SPAN}"/>'
        f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{label}</text>'
        f'<text x="{x:.1f}" y="{_TOP + _SPAN + 15}" text-anchor="middle">{label}</text>'
    )


def _mark(dot: tuple[float, float, float], scale: float) -> str:
    """A dot with its error bar, clipped to the axes."""
    true, measured, std = dot
    x = _LEFT + true * scale
    low, middle, high = (
        _TOP + _SPAN - min(max(value * scale, 0.0), _SPAN)
        for value in (measured - std, measured, measured + std)
    )
    return (
        f'<line x1="{x:.1f}" y1="{low:.1f}" x2="{x:.1f}" y2="{high:.1f}"/>'
        f'<circle cx="{x:.1f}" cy="{middle:.1f}" r="3.2"/>'
    )


def error_histogram(models: Sequence[ModelResult], quantity: str) -> str:
    """Plot how many trees have which error, measured minus true value; gross errors are marked.

    The first and the last bin also hold all errors beyond them.

    Returns:
        The SVG element; an empty string if nothing was measured.
    """
    style = QUANTITY_STYLES[quantity]
    errors = [_errors(model, quantity) for model in models]
    sizes = sorted(abs(error_m) for found in errors for error_m, _ in found)
    if not sizes:
        return ""
    # Nine of ten errors are inside; the largest would make the bins too wide for the others.
    common = sizes[math.ceil(0.9 * len(sizes)) - 1] * style.per_metre
    width = nice_axis(max(common, 10.0**-style.digits) / _BINS_PER_SIDE)[1]
    while width * _BINS_PER_SIDE < common:
        width *= 2
    edges = [f"{index * width:+g}" if index else "0" for index in _sides()]
    series = [_bars(found, width / style.per_metre) for found in errors]
    return bar_chart(f"{style.name} error, {style.unit}", edges, series)


def _sides() -> range:
    return range(-_BINS_PER_SIDE, _BINS_PER_SIDE + 1)


def _errors(model: ModelResult, quantity: str) -> list[tuple[float, bool]]:
    """The error in metres of each measured tree, and whether it is gross."""
    trees = (tree for frame in model.frames for tree in frame.trees)
    return [
        (error_m, tree.is_gross(quantity))
        for tree in trees
        if (error_m := tree.error_m(quantity)) is not None
    ]


def _bars(errors: Sequence[tuple[float, bool]], width_m: float) -> Bars:
    counts, marked = [0] * 2 * _BINS_PER_SIDE, [0] * 2 * _BINS_PER_SIDE
    for error_m, gross in errors:
        place = math.floor(error_m / width_m) + _BINS_PER_SIDE
        place = min(max(place, 0), len(counts) - 1)
        counts[place] += 1
        marked[place] += gross
    return Bars(counts, marked)
