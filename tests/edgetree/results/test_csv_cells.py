"""No spreadsheet finds a formula in a text, wherever it splits the line; numbers stay numbers."""

from __future__ import annotations

import csv
import io
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgetree.bench.result import csv_text
from edgetree.results.csv_cells import text_cell
from edgetree.results.csv_style import cell

NUMBER = re.compile(r"[+-]\d[\d.,]*(e[+-]?\d+)?")


def formulas(line: str, delimiter: str) -> list[str]:
    """The cells of a line that a spreadsheet takes for formulas."""
    cells = next(csv.reader([line], delimiter=delimiter))
    cells = [one.lstrip() for one in cells]
    return [one for one in cells if one and one[0] in "=+-@＝＋－＠" and not NUMBER.fullmatch(one)]


@pytest.mark.parametrize("sign", "=+-@＝＋－＠")
@pytest.mark.parametrize(
    "before", ["", " ", "\t", "\r", "\n", '"', "a;", "a; ", 'a;"', "a,", "a|", "a\t", "a ", "a ;\t"]
)
def test_a_formula_is_escaped_after_every_separator(before: str, sign: str) -> None:
    text = f"{before}{sign}SUM(A1)"
    stream = io.StringIO()
    csv.writer(stream).writerow([cell(text), -0.5])
    line = stream.getvalue().rstrip("\r\n")
    for delimiter in ",;|\t ":
        assert formulas(line, delimiter) == [], (line, delimiter)


@given(st.text('ab=+-@;,|\t "15.', max_size=12))
def test_whatever_the_text_semicolons_split_off_no_formula(text: str) -> None:
    for delimiter in ";|":
        assert formulas(text_cell(text).replace('"', ""), delimiter) == []


@pytest.mark.parametrize(
    "text",
    [
        "metres need depth: pass --depth and --camera",
        "from -0.5 to +0.3 m; -2",
        "diameters - and heights",
        "x = 5 m",
        "name@forest.example",
        "2026-11-27;a-b",
    ],
)
def test_prose_and_numbers_in_it_stay_as_they_are(text: str) -> None:
    assert text_cell(text) == text


@pytest.mark.parametrize("number", [-1, -0.5, +3.25, 0])
def test_numbers_are_no_texts(number: float) -> None:
    assert cell(number) == number
    assert isinstance(cell(number), type(number))


def test_several_texts_are_escaped_each() -> None:
    assert cell(("=1+1", "=2")) == "'=1+1; '=2"


def test_the_table_of_a_benchmark_is_escaped_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("edgetree.bench.result._CSV", {"model": ("model",), "ms": ("ms",)})
    assert csv_text({"rows": [{"model": "=1+1", "ms": -2.0}]}).splitlines() == [
        "model,ms",
        "'=1+1,-2.0",
    ]
