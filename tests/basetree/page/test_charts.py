"""Charts: round axes, marks at their values, well-formed SVG."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from basetree.page.axis import Axis, round_step
from basetree.page.charts import Part, Plot, legend, named_bars, series, stacked_bars


def parsed(svg: str) -> ElementTree.Element:
    return ElementTree.fromstring(svg)


def numbers(element: ElementTree.Element, *names: str) -> list[float]:
    return [float(element.attrib[name]) for name in names]


@pytest.mark.parametrize(
    ("span", "parts", "step"), [(10, 5, 2), (11, 5, 5), (0.7, 5, 0.2), (94, 8, 20), (0, 5, 2e-7)]
)
def test_a_step_is_round_and_small_enough(span: float, parts: int, step: float) -> None:
    assert round_step(span, parts) == pytest.approx(step)


def test_a_rounded_axis_holds_both_values_with_ticks_at_its_ends() -> None:
    axis = Axis.rounded(-3.2, 17.0, "cm")
    assert (axis.low, axis.high) == (-5, 20)
    assert [text for _, text in axis.ticks] == ["-5", "0", "5", "10", "15", "20"]
    assert [axis.place(value) for value in (-5, 7.5, 20, 99, -99)] == [0, 0.5, 1, 1, 0]
    whole = Axis.rounded(0, 2, whole=True)
    assert [text for _, text in whole.ticks] == ["0", "1", "2"]
    assert Axis.rounded(3, 3).high > Axis.rounded(3, 3).low


def test_of_many_bins_some_edges_are_written() -> None:
    axis = Axis.bins([f"{edge}" for edge in range(41)])
    assert (axis.low, axis.high) == (0, 40)
    assert [text for _, text in axis.ticks][:3] == ["0", "5", "10"]


def test_marks_are_at_their_values() -> None:
    plot = Plot(Axis.rounded(0, 10, "x"), Axis.rounded(0, 100, "y"), (240, 140))
    svg = plot.svg(
        "a < b", series(0, plot.dot(5, 50, "half & half"), plot.line([(0, 0), (10, 100)]))
    )
    root = parsed(svg)
    assert root.attrib["aria-label"] == "a < b"
    (dot,) = root.iter("circle")
    x, y = numbers(dot, "cx", "cy")
    (line,) = (each for each in root.iter("path") if each.attrib["class"] == "line")
    x0, y0, x1, y1 = map(float, re.findall(r"[\d.]+", line.attrib["d"]))
    assert (x, y) == pytest.approx(((x0 + x1) / 2, (y0 + y1) / 2))
    assert y1 < y0
    assert [title.text for title in root.iter("title")] == ["half & half"]


def test_bars_of_several_series_share_a_bin_and_stand_on_zero() -> None:
    plot = Plot(Axis.bins(["a", "b", "c"]), Axis.rounded(0, 4))
    one = plot.bars([0, 1, 2], [4, 0], ["four", "none"], place=(0, 2))
    other = plot.bars([0, 1, 2], [2, 2], place=(1, 2))
    bars = list(parsed(plot.svg("bars", series(0, one), series(1, other))).iter("rect"))
    assert len(bars) == 3
    (x0, y0, w0, h0), (x1, y1, w1, h1), _ = (
        numbers(bar, "x", "y", "width", "height") for bar in bars
    )
    assert x0 + w0 <= x1
    assert w0 == w1
    assert y0 + h0 == pytest.approx(y1 + h1, abs=0.2)
    assert h0 == pytest.approx(2 * h1, abs=0.2)


def test_what_is_outside_of_the_axes_is_at_their_ends() -> None:
    plot = Plot(Axis.rounded(0, 1), Axis.rounded(0, 1))
    inside, outside = plot.line([(0, 0), (1, 1)]), plot.line([(-9, -9), (9, 9)])
    assert inside == outside
    assert plot.line([]) == ""


def test_a_stacked_bar_is_divided_by_the_values_and_labelled_where_there_is_room() -> None:
    parts = [Part(3, "large", "3 of 4"), Part(0.99, "some", "1"), Part(0.01, "few", "0.01 of 4")]
    root = parsed(stacked_bars("parts", [("row", parts)], 400))
    widths = [numbers(bar, "width")[0] for bar in root.iter("rect")]
    assert widths == pytest.approx([300, 99, 1])
    assert [text.text for text in root.iter("text")] == ["row", "large", "some"]
    assert len(list(parsed(stacked_bars("none", [("row", [Part(0, "a", "a")])])).iter("rect"))) == 0


def test_named_bars_give_counts_and_percentages() -> None:
    root = parsed(named_bars("species", {"fir <": 3000, "oak": 1000, "ash": 0}))
    texts = [text.text for text in root.iter("text")]
    assert texts == ["fir <", "3,000 · 75 %", "oak", "1,000 · 25 %", "ash", "0 · 0 %"]
    parsed(named_bars("nothing", {}))


def test_the_legend_has_the_colours_of_the_series() -> None:
    html = legend([(0, "a <"), (2, "c")])
    assert re.findall(r'class="key (\w+)"', html) == ["first", "third"]
    assert "a &lt;" in html


def test_crowded_ticks_are_thinned_out_and_few_are_all_shown() -> None:
    def shown(*texts: str) -> list[str]:
        ticks = tuple((float(n), text) for n, text in enumerate(texts))
        svg = Plot(Axis(0, len(texts) - 1, ticks), Axis(0, 1)).svg("errors")
        return re.findall(r'text-anchor="middle"[^>]*>([^<]+)<', svg)

    assert shown("0", "1", "2") == ["0", "1", "2"]
    crowded = [f"+0.0{n}" for n in range(9)]
    assert shown(*crowded) == crowded[::2]
