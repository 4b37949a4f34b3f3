"""The table of all trees, the reasons for missing values, and the diameter classes."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from typing import Final

from basetree.page import charts, parts
from basetree.page.axis import Axis
from edgetree.measure import Estimate, Failure, PixelSize, TreeMeasurement
from edgetree.report.profile_chart import further_values_html
from edgetree.report.units import CLASS_EDGE, UNITS, length_attributes, tick_text, unit_name
from edgetree.results.text_table import failure_reasons, has_diameter, pixel_words
from edgetree.results.units import AMOUNTS, direction_words

_CLASS_CM: Final = 4
_NUMBER: Final = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?![\w])")
_COLUMNS: Final = ("diameter_m", "dbh_m", "cut_height_m", "inclination_deg", "distance_m")
_MISSING: Final = parts.Cell("–", 'class="none"')


def tree_row(
    anchor: str,
    frame: str,
    name: str,
    score: float,
    measured: TreeMeasurement,
    size: PixelSize | Failure,
) -> str:
    """The row of one tree.

    Args:
        anchor: id of the frame's picture.
        frame: Name of the frame.
        name: What the picture calls the tree: its number, or # and that of a followed stem, or
            a word for a stem without a number, which is sorted to the end.
        score: Score of the detection.
        measured: Its measurement.
        size: Its size in the picture.
    """
    notes = [f"{what}: {reason}" for what, reason in failure_reasons(measured)]
    notes += [f"warning: {text}" for text in measured.evidence.warnings]
    if measured.evidence.distance_from not in ("depth", ""):
        notes.append(f"distance from {measured.evidence.distance_from}")
    if not has_diameter(measured):
        notes.append(pixel_words(size))
    items = [*(escape(note) for note in notes), *further_values_html(measured)]
    remarks = "".join(f"<li>{item}</li>" for item in items)
    number = name.removeprefix("#")
    sorted_by = f'data-value="{number}"' if number.isdecimal() else 'class="none"'
    return parts.row(
        [
            parts.Cell(f'<a href="#{anchor}">{escape(frame)}</a>', 'data-name="frame"'),
            parts.Cell(name, f'data-name="tree" {sorted_by}'),
            *(_cell(measured, name) for name in _COLUMNS),
            parts.Cell(f"{score:.0%}", f'data-name="score" data-value="{float(score):.4f}"'),
            parts.Cell(f"<ul>{remarks}</ul>", 'class="notes"') if remarks else _MISSING,
        ]
    )


def _cell(tree: TreeMeasurement, quantity: str) -> parts.Cell:
    """A value with its ±."""
    result: Estimate | Failure = getattr(tree, quantity)
    if isinstance(result, Failure):
        return _MISSING
    amount = AMOUNTS[quantity]
    text, name = amount.with_std(result), f'data-name="{amount.name}"'
    if quantity in UNITS["mm"]:
        return parts.Cell(text, f"{name} {length_attributes(quantity, result)}")
    words = direction_words(result, tree.lean_direction_deg)
    numbers = f'data-value="{float(result.value)!r}" data-std="{float(result.std)!r}"'
    return parts.Cell(f"{text} {words}", f"{name} {numbers}")


def tree_table(rows: Sequence[str]) -> str:
    """The table of all trees, from `tree_row`; a click on a column's head sorts it."""
    if not rows:
        return "<p>No trees.</p>"
    names = ("frame", "tree", *(AMOUNTS[name].name for name in _COLUMNS), "score", "remarks")
    heads = [parts.Cell(f'<button type="button">{name}</button>') for name in names]
    return parts.table(heads, rows, kind="sortable text")


class Reasons:
    """Why values are missing, each reason once; reasons that differ in numbers only are one."""

    def __init__(self) -> None:
        self._trees: Counter[str] = Counter()
        self._numbers: dict[str, list[list[str]]] = {}
        self._missing: dict[str, dict[str, None]] = {}

    def add(self, tree: TreeMeasurement) -> None:
        """Count the reasons of a tree, each once."""
        found = [(what, text, _NUMBER.sub("{}", text)) for what, text in failure_reasons(tree)]
        self._trees.update({reason for _, _, reason in found})
        for what, text, reason in found:
            self._numbers.setdefault(reason, []).append(_NUMBER.findall(text))
            names = what.removeprefix("no ").split(", ")
            self._missing.setdefault(reason, {}).update(dict.fromkeys(names))

    def html(self) -> str:
        """The number of trees for each reason, with what it leaves out; empty if there is none."""
        if not self._trees:
            return ""
        ordered = sorted(self._trees.items(), key=lambda item: (-item[1], item[0]))
        rows = ([str(trees), self._words(reason), self._text(reason)] for reason, trees in ordered)
        return parts.heading("Missing values") + parts.table(
            ["trees", "missing", "reason"], rows, kind="text"
        )

    def _text(self, reason: str) -> str:
        """The reason with its numbers, or with their range where they differ."""
        words = reason.split("{}")
        for index, found in enumerate(zip(*self._numbers[reason], strict=True)):
            low, high = min(found, key=float), max(found, key=float)
            words[index] += low if low == high else f"{low} to {high}"
        return "".join(words)

    def _words(self, reason: str) -> str:
        names = self._missing[reason]
        return "all values" if "not measured" in names else ", ".join(names)


def class_chart(name: str, diameters_m: Iterable[float]) -> str:
    """A histogram of diameters in classes of 4 cm as a card; empty if there are no diameters."""
    classes = Counter(math.floor(100 * value / _CLASS_CM) for value in diameters_m)
    if not classes:
        return ""
    inside = range(min(classes), max(classes) + 1)
    counts = [classes[index] for index in inside]
    edges_cm = [_CLASS_CM * index for index in range(inside.start, inside.stop + 1)]
    texts = [tick_text(CLASS_EDGE, edge_cm / 100, f"{edge_cm}") for edge_cm in edges_cm]
    plot = charts.Plot(
        Axis.bins(texts, unit_name(CLASS_EDGE)),
        Axis.rounded(0, max(counts), "trees", whole=True),
    )
    bars = plot.bars(range(len(texts)), counts, [f"trees: {count}" for count in counts])
    return parts.card(name, plot.svg(name, charts.series(0, bars)))
