"""Axes of charts: round ends and ticks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

__all__ = ["Axis", "round_step"]

_MAX_EDGES: Final = 9


def round_step(span: float, parts: int) -> float:
    """The smallest of 1, 2 and 5 times a power of ten that divides a span into at most `parts`."""
    rough = max(span, 1e-6) / parts
    magnitude = 10.0 ** math.floor(math.log10(rough))
    return magnitude * min((m for m in (1, 2, 5) if m * magnitude >= rough), default=10)


def _plain(value: float) -> str:
    return f"{value:g}"


@dataclass(frozen=True)
class Axis:
    """The values along one side of a chart.

    Attributes:
        low: Value at the beginning.
        high: Value at the end, another one.
        ticks: Values, and what is written at each of them as content of an SVG text.
        name_html: What the values are, with their unit, likewise; nothing if empty.
        is_logarithmic: Whether equal ratios have equal lengths; all values are then above 0.
    """

    low: float
    high: float
    ticks: tuple[tuple[float, str], ...] = ()
    name_html: str = ""
    is_logarithmic: bool = False

    @classmethod
    def logarithmic(cls, low: float, high: float, name_html: str = "") -> Axis:
        """A logarithmic axis from 1, 2 or 5 times a power of ten to another, around both values."""
        powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        steps = [m * 10.0**power for power in powers for m in (1, 2, 5)]
        first = max(step for step in steps if step <= low)
        last = min(step for step in steps if step >= high and step > first)
        ticks = tuple((step, _plain(step)) for step in steps if first <= step <= last)
        return cls(first, last, ticks, name_html, is_logarithmic=True)

    @classmethod
    def rounded(
        cls,
        low: float,
        high: float,
        name_html: str = "",
        *,
        parts: int = 5,
        whole: bool = False,
        text: Callable[[float], str] = _plain,
    ) -> Axis:
        """An axis with round ends that holds both values.

        Args:
            low: Smallest value.
            high: Largest value.
            name_html: What the values are.
            parts: Number of steps between ticks, about.
            whole: Whether only whole numbers have ticks.
            text: What is written at a value, as content of an SVG text.
        """
        step = max(round_step(high - low, parts), float(whole))
        first = math.floor(low / step)
        last = max(math.ceil(high / step), first + 1)
        ticks = tuple((n * step, text(n * step)) for n in range(first, last + 1))
        return cls(ticks[0][0], ticks[-1][0], ticks, name_html)

    @classmethod
    def bins(cls, edges_html: Sequence[str], name_html: str = "") -> Axis:
        """An axis of bins, the first from 0 to 1, the second from 1 to 2 and so on.

        Args:
            edges_html: The edges of the bins, one more than there are bins. Of many, only some
                are written.
            name_html: What the edges are.
        """
        every = math.ceil(len(edges_html) / _MAX_EDGES)
        ticks = tuple((float(n), text) for n, text in enumerate(edges_html) if n % every == 0)
        return cls(0.0, len(edges_html) - 1.0, ticks, name_html)

    def place(self, value: float) -> float:
        """Position of a value, from 0 to 1, limited to the axis."""
        low, high = self.low, self.high
        if self.is_logarithmic:
            value, low, high = math.log(max(value, low)), math.log(low), math.log(high)
        return min(max((value - low) / (high - low), 0.0), 1.0)
