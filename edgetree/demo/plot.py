"""Charts of measured and true values, and of errors, each as a card."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from basetree.page import charts, parts
from basetree.page.axis import Axis, round_step
from edgetree.check import Comparison
from edgetree.demo.comparison import is_gross
from edgetree.demo.result import ModelResult
from edgetree.demo.tables import SHOWN

_BINS_PER_SIDE: Final = 4
_SQUARE_PX: Final = (320, 322)


def scatter_plot(models: Sequence[ModelResult], quantity: str) -> str:
    """Plot the measured over the true value of each tree, with error bars of one std.

    Both axes have the same scale and start at zero, so perfect measurements lie on the dashed
    diagonal. Empty if nothing was measured.
    """
    amount = SHOWN[quantity]
    found = [model.compared(quantity) for model in models]
    trees = [each for of_model in found for each in of_model]
    if not trees:
        return ""
    largest_m = max(max(abs(each.measured.value), each.caliper.value) for each in trees)
    end = largest_m * amount.per_unit
    plot = charts.Plot(Axis.rounded(0, end, "true"), Axis.rounded(0, end, "measured"), _SQUARE_PX)
    marks = [
        charts.series(number, *(_mark(plot, each, amount.per_unit) for each in of_model))
        for number, of_model in enumerate(found)
    ]
    name = f"{amount.name.capitalize()}, {amount.unit}"
    return parts.card(name, plot.svg(name, plot.diagonal(), *marks))


def _mark(plot: charts.Plot, found: Comparison, per_unit: float) -> str:
    """A dot with its error bar."""
    true, (value, std) = found.caliper.value * per_unit, found.measured
    ends = [(true, (value + side * std) * per_unit) for side in (-1, 1)]
    return plot.line(ends, "spread") + plot.dot(true, value * per_unit)


def error_histogram(models: Sequence[ModelResult], quantity: str) -> str:
    """Plot how many trees have which error, measured minus true value; gross errors are marked.

    The first and the last bin also hold all errors beyond them. Empty if nothing was measured.
    """
    amount = SHOWN[quantity]
    found = [model.compared(quantity) for model in models]
    sizes = sorted(abs(each.error.value) * amount.per_unit for trees in found for each in trees)
    if not sizes:
        return ""
    # Nine of ten errors are inside; the largest would make the bins too wide for the others.
    common = sizes[math.ceil(0.9 * len(sizes)) - 1]
    width = round_step(max(common, 10.0**-amount.digits), _BINS_PER_SIDE)
    edges = [n * width for n in range(-_BINS_PER_SIDE, _BINS_PER_SIDE + 1)]
    counts = [_counts(trees, width / amount.per_unit) for trees in found]
    gross = [[each for each in trees if is_gross(quantity, each)] for trees in found]
    marked = [_counts(trees, width / amount.per_unit) for trees in gross]
    plot = charts.Plot(
        Axis.bins([f"{edge:+g}" if edge else "0" for edge in edges], amount.unit),
        Axis.rounded(0, max(map(max, counts)), "trees", whole=True),
    )
    marks = (
        charts.series(number, _bars(plot, counts[number], marked[number], (number, len(models))))
        for number in range(len(models))
    )
    name = f"{amount.name.capitalize()} error, {amount.unit}"
    return parts.card(name, plot.svg(name, *marks))


def _counts(found: Sequence[Comparison], width_m: float) -> list[int]:
    """The number of errors in each bin."""
    counts = [0] * 2 * _BINS_PER_SIDE
    for each in found:
        place = math.floor(each.error.value / width_m) + _BINS_PER_SIDE
        counts[min(max(place, 0), len(counts) - 1)] += 1
    return counts


def _bars(plot: charts.Plot, trees: list[int], gross: list[int], place: tuple[int, int]) -> str:
    """The bars of one of the models that share each bin, the gross errors at their bottom."""
    bins = range(len(trees) + 1)
    return plot.bars(bins, trees, [f"trees: {n}" for n in trees], place=place) + plot.bars(
        bins, gross, [f"gross errors: {n}" for n in gross], place=place, kind="gross"
    )
