"""Plots of a check, drawn with OpenCV."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from basetree.counts import counted
from basetree.page.axis import Axis
from edgetree.check.comparison import Comparison
from edgetree.check.quantities import OUTLIER_STDS, QuantityCheck
from edgetree.check.report import QUANTITY_NAMES
from edgetree.drawing.primitives import (
    Colour,
    Picture,
    Point,
    draw_dot,
    draw_line,
    text_size,
    write_text,
)

_WIDTH, _HEIGHT = 1640, 860
_PANEL, _TOP, _LEFT, _GAP = 690, 84, 100, 120
_TICKS: Final = 8
_FONT: Final = 0.62
_LINE_WIDTH: Final = 1
_DOT_RADIUS: Final = 4.5
_NORMAL_975: Final = 1.96

_INK: Final[Colour] = (40, 40, 40)
_GRID: Final[Colour] = (225, 225, 225)
_DOTS: Final[Colour] = (160, 95, 25)
_OUTLIER: Final[Colour] = (40, 40, 215)
_BIAS: Final[Colour] = (60, 140, 40)


def draw_check(check: QuantityCheck) -> Picture:
    """Draw the measured over the caliper's values, and the errors over the caliper's values.

    Bars are 95 % intervals. Outliers are red.

    Returns:
        (860, 1640, 3) uint8 BGR.
    """
    canvas = _Canvas()
    name = QUANTITY_NAMES[check.quantity]
    sides = [value for each in check.comparisons for value in _sides(each)]
    values = [*sides, *(each.caliper.value * 100 for each in check.comparisons)]
    both = Axis.rounded(min(values), max(values), parts=_TICKS)
    canvas.panel(_LEFT, f"{name}: measured, cm", "caliper, cm", both, both)
    canvas.line((_LEFT, _TOP + _PANEL), (_LEFT + _PANEL, _TOP), _INK)
    canvas.marks(check, _LEFT, both, both, lambda each: each.measured.value * 100)
    ends = [end - each.caliper.value * 100 for each in check.comparisons for end in _sides(each)]
    errors = Axis.rounded(min(*ends, 0.0), max(*ends, 0.0), parts=_TICKS)
    left = _LEFT + _PANEL + _GAP
    canvas.panel(left, f"{name}: measured - caliper, cm", "caliper, cm", both, errors)
    for value, colour in ((0.0, _INK), (check.bias_m * 100, _BIAS)):
        y = _TOP + _PANEL * (1 - errors.place(value))
        canvas.line((left, y), (left + _PANEL, y), colour)
    canvas.marks(check, left, both, errors, lambda each: each.error.value * 100)
    canvas.legend(check)
    return canvas.pixels


def _sides(comparison: Comparison) -> tuple[float, float]:
    """Both ends of the measured value's bar, cm."""
    reach = _NORMAL_975 * comparison.error.std
    return (comparison.measured.value - reach) * 100, (comparison.measured.value + reach) * 100


class _Canvas:
    """The picture `pixels` and what is drawn on it."""

    def __init__(self) -> None:
        self.pixels: Picture = np.full((_HEIGHT, _WIDTH, 3), 255, np.uint8)

    def line(self, start: Point, end: Point, colour: Colour) -> None:
        """Draw a line."""
        draw_line(self.pixels, start, end, colour, _LINE_WIDTH)

    def text(self, text: str, x: float, y: float, align: float, colour: Colour = _INK) -> None:
        """Write a line of text; `align` is 0 to begin at x, 0.5 for the middle, 1 to end there."""
        width, _ = text_size(text, _FONT)
        write_text(self.pixels, text, (round(x - align * width), round(y)), _FONT, colour)

    def panel(self, left: float, title: str, below: str, across: Axis, up: Axis) -> None:
        """Draw the grid, the numbers and the names of the axes."""
        bottom, right = _TOP + _PANEL, left + _PANEL
        for value, text in across.ticks:
            x = left + _PANEL * across.place(value)
            self.line((x, _TOP), (x, bottom), _GRID)
            self.text(text, x, bottom + 28, 0.5)
        for value, text in up.ticks:
            y = bottom - _PANEL * up.place(value)
            self.line((left, y), (right, y), _GRID)
            self.text(text, left - 12, y + 7, 1.0)
        self.text(title, left, _TOP - 18, 0.0)
        self.text(below, right, bottom + 60, 1.0)

    def marks(
        self,
        check: QuantityCheck,
        left: float,
        across: Axis,
        up: Axis,
        value_cm: Callable[[Comparison], float],
    ) -> None:
        """Draw a dot and a bar for each stem; outliers last."""
        bottom = _TOP + _PANEL
        for each in sorted(check.comparisons, key=lambda each: abs(each.standardised)):
            colour = _OUTLIER if abs(each.standardised) > OUTLIER_STDS else _DOTS
            value, reach = value_cm(each), _NORMAL_975 * each.error.std * 100
            x = left + _PANEL * across.place(each.caliper.value * 100)
            low, middle, high = (
                bottom - _PANEL * up.place(end) for end in (value - reach, value, value + reach)
            )
            self.line((x, low), (x, high), colour)
            draw_dot(self.pixels, (x, middle), _DOT_RADIUS, colour)

    def legend(self, check: QuantityCheck) -> None:
        """Explain bars, colours and lines in one row at the top."""
        count, left_out = len(check.outliers), len(check.gross_errors)
        self.text(
            f"{counted(len(check.comparisons), 'stem')}; bars: 95 % intervals", _LEFT, 30, 0.0
        )
        text = f"outliers: {count}" + (f", left out: {left_out}" if left_out else "")
        self.text(text, _LEFT + _PANEL, 30, 1.0, _OUTLIER if count or left_out else _INK)
        bias = f"green line: mean error {check.bias_m * 100:+.2f} cm"
        self.text(bias, _LEFT + _PANEL + _GAP, 30, 0.0, _BIAS)
