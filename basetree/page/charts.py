"""Charts as inline SVG; the page's style gives the colours."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Final, NamedTuple, TypeAlias

from basetree.page.axis import Axis

__all__ = ["Part", "Plot", "key", "legend", "named_bars", "series", "stacked_bars"]

_SERIES: Final = ("first", "second", "third")
_LARGEST: Final = 1.25  # of the width in which the text is as large as on the page
_LEFT, _RIGHT, _TOP, _BOTTOM, _NAME = 38, 18, 8, 20, 15
_BARS_WIDTH, _ROW, _BAR, _NAME_WIDTH, _VALUE_WIDTH = 340, 24, 16, 104, 84
_LETTER_PX: Final = 7
_NAME_OFFSETS_PX: Final = tuple(
    offset for line in range(8) for offset in (16 + 12 * line, -8 - 12 * line)
)

Points: TypeAlias = Iterable[tuple[float, float]]
Box: TypeAlias = tuple[float, float, float, float]


def series(number: int, *marks: str, kind: str = "") -> str:
    """Marks in the colour of a series.

    Args:
        number: Index of the series, 0 to 2.
        marks: What the methods of `Plot` give.
        kind: "over" for bars that others may stand behind.
    """
    return f'<g class="{_SERIES[number]} {kind}">{"".join(marks)}</g>'


def legend(names: Iterable[tuple[int, str]]) -> str:
    """Index and name of each series, as a line of text."""
    return " ".join(f"{key(_SERIES[number])} {escape(name)}" for number, name in names)


def key(kind: str, sign: str = "●", colour: str = "") -> str:
    """A coloured sign in front of a name.

    Args:
        kind: Class that gives the colour: "first", "second", "third", "gross", "part0" and so on.
        sign: The sign.
        colour: a CSS colour instead.
    """
    style = f' style="color:{colour}"' if colour else ""
    return f'<span class="key {kind}"{style}>{sign}</span>'


class Plot:
    """A chart with two axes. Its methods make marks at values; `svg` puts all together."""

    def __init__(self, across: Axis, up: Axis, size_px: tuple[int, int] = (340, 200)) -> None:
        """Prepare a chart.

        Args:
            across: The horizontal axis.
            up: The vertical axis.
            size_px: Width and height; the page scales the chart to the width that it has.
        """
        self._across, self._up = across, up
        self._width, self._height = size_px
        self._top = _TOP + (_NAME if up.name_html else 0)
        self._right = self._width - _RIGHT
        self._bottom = self._height - _BOTTOM - (_NAME if across.name_html else 0)

    def svg(self, name: str, *marks: str, kind: str = "") -> str:
        """The chart as an SVG element; `name` says what it shows to those who cannot see it."""
        return _svg(name, (self._width, self._height), [self._axes(), *marks], kind)

    def _axes(self) -> str:
        parts = [
            _text(self._x(value), self._bottom + 15, text, "middle")
            for value, text in self._spaced_ticks()
        ]
        for value, text in self._up.ticks:
            y = self._y(value)
            parts.append(f'<path class="axis" d="M{_LEFT} {y:.1f}H{self._right}"/>')
            parts.append(_text(_LEFT - 6, y + 4, text, "end"))
        if self._up.name_html:
            parts.append(_text(_LEFT, 13, f"↑ {self._up.name_html}"))
        if self._across.name_html:
            name = f"{self._across.name_html} →"
            parts.append(_text(self._right, self._height - 5, name, "end"))
        return "".join(parts)

    def _spaced_ticks(self) -> Sequence[tuple[float, str]]:
        """The horizontal axis's ticks, or every second or third if they are crowded."""
        ticks = self._across.ticks
        if len(ticks) < 3:
            return ticks
        letters = max(len(re.sub(r"<[^>]*>", "", text)) for _, text in ticks)
        step_px = abs(self._x(ticks[1][0]) - self._x(ticks[0][0]))
        return ticks[:: math.ceil((letters + 1) * _LETTER_PX / step_px)]

    def _x(self, value: float) -> float:
        return _LEFT + self._across.place(value) * (self._right - _LEFT)

    def _y(self, value: float) -> float:
        return self._bottom - self._up.place(value) * (self._bottom - self._top)

    def line(self, points: Points, kind: str = "line") -> str:
        """A line through points; of the kind "ideal" it is dashed, a "band" is filled."""
        path = "L".join(f"{self._x(x):.1f} {self._y(y):.1f}" for x, y in points)
        return f'<path class="{kind}" d="M{path}{"Z" if kind == "band" else ""}"/>' if path else ""

    def diagonal(self) -> str:
        """A dashed line from the beginning of both axes to their ends."""
        first, last = (self._across.low, self._up.low), (self._across.high, self._up.high)
        return self.line([first, last], "ideal")

    def dot(self, x: float, y: float, hint: str = "", text: str = "") -> str:
        """A dot, a text below it, and a hint that is shown when the pointer is on it."""
        at_x, at_y = self._x(x), self._y(y)
        side = "end" if self._across.place(x) > 0.5 else "start"
        label = _text(at_x, at_y + 16, escape(text), side) if text else ""
        title = f"<title>{escape(hint)}</title>" if hint else ""
        return f'<circle cx="{at_x:.1f}" cy="{at_y:.1f}" r="3.2">{title}</circle>{label}'

    def named_dots(self, dots: Iterable[tuple[float, float, str, str]]) -> list[str]:
        """Dots with names that do not cover each other, from (x, y, hint, name) of each.

        A name stands below its dot, or as near above or below as there is room; without room within
        eight lines the hint alone tells it.
        """
        marks, taken = [], []
        named = sorted(dots)
        for x, y, *_ in named:
            taken.append((self._x(x) - 4, self._x(x) + 4, self._y(y) - 4, self._y(y) + 4))
        for x, y, hint, name in named:
            at_x, at_y, length = self._x(x), self._y(y), _LETTER_PX * len(name)
            side = "end" if self._across.place(x) > 0.5 else "start"
            left = at_x - length if side == "end" else at_x
            for below_px in _NAME_OFFSETS_PX:
                low = at_y + below_px
                box = (left, left + length, low - 10, low + 2)
                if (
                    self._top <= box[2]
                    and low <= self._bottom
                    and not any(_overlap(box, other) for other in taken)
                ):
                    taken.append(box)
                    marks.append(_text(at_x, low, escape(name), side))
                    break
            marks.append(self.dot(x, y, hint))
        return marks

    def cloud(self, points: Points) -> str:
        """Many small dots."""
        path = "".join(f"M{self._x(x):.1f} {self._y(y):.1f}h0" for x, y in points)
        return f'<path class="cloud" d="{path}"/>'

    def bars(
        self,
        edges: Sequence[float],
        values: Sequence[float],
        hints: Sequence[str] | None = None,
        *,
        place: tuple[int, int] = (0, 1),
        kind: str = "",
    ) -> str:
        """Vertical bars from zero; none where the value is zero.

        Args:
            edges: The edges of the bins on the horizontal axis, one more than there are values.
            values: The height of each bar.
            hints: What is shown when the pointer is on a bar.
            place: Index and number of the series that share the width of the bins.
            kind: "gross" for bars of gross errors.
        """
        drawn = []
        for index, value in enumerate(values):
            first, last = self._x(edges[index]), self._x(edges[index + 1])
            width = (last - first) / place[1]
            x, y = first + place[0] * width + 0.5, self._y(value)
            box = (x, y, max(width - 1, 1), self._y(0) - y)
            if value:
                drawn.append(_rect(kind, box, hints[index] if hints else ""))
        return "".join(drawn)

    def picture(self, png: bytes) -> str:
        """A picture, the content of a PNG file, over the whole area between the axes."""
        data = base64.b64encode(png).decode("ascii")
        return (
            f'<image href="data:image/png;base64,{data}" x="{_LEFT}" y="{self._top}"'
            f' width="{self._right - _LEFT}" height="{self._bottom - self._top}"'
            ' preserveAspectRatio="none"/>'
        )


def named_bars(name: str, counts: Mapping[str, int], total: int | None = None) -> str:
    """A horizontal bar for each named count, with its number and its percentage.

    Args:
        name: What the chart shows.
        counts: The counts.
        total: What they are shares of, if not of their sum, as several may count one thing.
    """
    most = max(1, *counts.values(), 1)
    total = max(1, sum(counts.values()) if total is None else total)
    drawn = []
    for number, (title, count) in enumerate(counts.items()):
        y, length = number * _ROW, (_BARS_WIDTH - _NAME_WIDTH - _VALUE_WIDTH) * count / most
        share = f"{count:,} · {100 * count / total:.0f} %"
        drawn += [
            _text(_NAME_WIDTH - 8, y + 16, escape(title), "end"),
            _rect("part0", (_NAME_WIDTH, y + 4, length, _BAR)),
            _text(_NAME_WIDTH + length + 6, y + 16, share),
        ]
    return _svg(name, (_BARS_WIDTH, _ROW * max(len(counts), 1)), drawn)


class Part(NamedTuple):
    """A part of a stacked bar.

    Attributes:
        value: Its size, in the unit of the other parts.
        text: What is written on it, if there is room.
        hint: What is shown when the pointer is on it.
    """

    value: float
    text: str
    hint: str


def stacked_bars(
    name: str, rows: Sequence[tuple[str, Sequence[Part]]], width_px: int = _BARS_WIDTH
) -> str:
    """A horizontal bar for each row, divided into its parts; all bars have the same length.

    Args:
        name: What the chart shows.
        rows: The title of each bar, which stands above it, and its parts, up to eight.
        width_px: Width of the chart.
    """
    drawn = []
    for number, (title, parts) in enumerate(rows):
        y, x = (2 * number + 1) * _ROW, 0.0
        total = sum(part.value for part in parts) or 1.0
        drawn.append(_text(0, y - 8, escape(title)))
        for index, part in enumerate(parts):
            length = width_px * part.value / total
            if length:
                drawn.append(_rect(f"part{index}", (x, y, length, _BAR), part.hint))
            if length > _LETTER_PX * (len(part.text) + 1):
                drawn.append(_text(x + length / 2, y + 12, escape(part.text), "middle", "on"))
            x += length
    return _svg(name, (width_px, 2 * _ROW * len(rows)), drawn)


def _svg(name: str, size: tuple[int, int], content: Iterable[str], kind: str = "") -> str:
    return (
        f'<svg class="{kind}" viewBox="0 0 {size[0]} {size[1]}" role="img"'
        f' style="max-width:{_LARGEST * size[0]:.0f}px" aria-label="{escape(name)}">'
        f"{''.join(content)}</svg>"
    )


def _overlap(one: Box, other: Box) -> bool:
    """Whether two boxes (left, right, top, bottom) have a common part."""
    return one[0] < other[1] and other[0] < one[1] and one[2] < other[3] and other[2] < one[3]


def _text(x: float, y: float, text_html: str, side: str = "start", kind: str = "") -> str:
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{side}">{text_html}</text>'


def _rect(kind: str, box: tuple[float, float, float, float], hint: str = "") -> str:
    x, y, width, height = box
    title = f"<title>{escape(hint)}</title>" if hint else ""
    return (
        f'<rect class="{kind}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}"'
        f' height="{height:.1f}">{title}</rect>'
    )
