"""Scatter plots of measured and true values as SVG, without a plotting library."""

from __future__ import annotations

import math
from collections.abc import Sequence

from edgetree.demo.result import ModelResult
from edgetree.demo.tables import QUANTITY_STYLES

__all__ = ["scatter_plot"]

_SIZE, _LEFT, _BOTTOM, _TOP = 300, 38, 34, 24
_SPAN = _SIZE - _LEFT - 10


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
    top, step = _nice_axis(max(values_m) * style.per_metre)
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


def _nice_axis(largest: float) -> tuple[float, float]:
    """(end, step) of an axis from zero to at least `largest`, with four to ten round steps."""
    rough = max(largest, 1e-6) / 5.0
    magnitude = 10.0 ** math.floor(math.log10(rough))
    step = magnitude * min((m for m in (1, 2, 5, 10) if m * magnitude >= rough), default=10)
    return step * math.ceil(largest / step + 1e-9), step


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
