"""The table of all trees, the reasons for missing values, and the diameter classes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from typing import Final

from edgetree.measure import Estimate, Failure, TreeMeasurement
from edgetree.report.charts import Bars, bar_chart
from edgetree.report.page import scrolling
from edgetree.report.profile_chart import further_values_html
from edgetree.report.units import CLASS_EDGE, UNITS, length_attributes, unit_name
from edgetree.results.text_table import failure_reasons
from edgetree.results.units import AMOUNTS, direction_words

__all__ = ["class_chart", "reason_table", "tree_row", "tree_table"]

_CLASS_CM: Final = 4
_COLUMNS: Final = ("diameter_m", "dbh_m", "cut_height_m", "inclination_deg", "distance_m")
_MISSING: Final = '<td class="none">–</td>'


def tree_row(anchor: str, frame: str, number: int, score: float, measured: TreeMeasurement) -> str:
    """The row of one tree.

    Args:
        anchor: id of the frame's picture.
        frame: name of the frame.
        number: number of the tree in the picture.
        score: score of the detection.
        measured: its measurement.
    """
    lengths = "".join(_cell(measured, name) for name in _COLUMNS)
    notes = [f"{what}: {reason}" for what, reason in failure_reasons(measured)]
    notes += [f"warning: {text}" for text in measured.evidence.warnings]
    items = [*(escape(note) for note in notes), *further_values_html(measured)]
    remarks = "".join(f"<li>{item}</li>" for item in items)
    return (
        f'<tr><td data-name="frame"><a href="#{anchor}">{escape(frame)}</a></td>'
        f'<td data-name="tree" data-value="{number}">{number}</td>{lengths}'
        f'<td data-name="score" data-value="{float(score):.4f}">{score:.0%}</td>'
        + (f'<td class="notes"><ul>{remarks}</ul></td></tr>' if remarks else f"{_MISSING}</tr>")
    )


def _cell(tree: TreeMeasurement, quantity: str) -> str:
    """A value with its ±."""
    result: Estimate | Failure = getattr(tree, quantity)
    if isinstance(result, Failure):
        return _MISSING
    amount = AMOUNTS[quantity]
    text, name = amount.with_std(result), amount.name
    if quantity in UNITS["mm"]:
        return f'<td data-name="{name}" {length_attributes(quantity, result)}>{text}</td>'
    words = direction_words(result, tree.lean_direction_deg)
    return f'<td data-name="{name}" data-value="{float(result.value)!r}">{text} {words}</td>'


def tree_table(rows: Sequence[str]) -> str:
    """The table of all trees, from `tree_row`; a click on a column's head sorts it."""
    if not rows:
        return "<p>No trees.</p>"
    names = ("frame", "tree", *(AMOUNTS[name].name for name in _COLUMNS), "score", "remarks")
    heads = "".join(f'<th scope="col"><button type="button">{name}</button></th>' for name in names)
    return scrolling(
        '<table class="sortable text"><thead><tr>'
        f"{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    )


def reason_table(reasons: Counter[tuple[str, str]]) -> str:
    """The number of trees for each (missing values, reason); empty if nothing is missing."""
    if not reasons:
        return ""
    ordered = sorted(reasons.items(), key=lambda item: (-item[1], item[0]))
    rows = "".join(
        f'<tr><td>{trees}</td><td class="wide">{escape(what)}</td>'
        f'<td class="wide">{escape(reason)}</td></tr>'
        for (what, reason), trees in ordered
    )
    return "<h2>Missing values</h2>" + scrolling(
        '<table class="text"><thead><tr><th scope="col">trees</th><th scope="col">missing</th>'
        f'<th scope="col">reason</th></tr></thead><tbody>{rows}</tbody></table>'
    )


def class_chart(name: str, diameters_m: Iterable[float]) -> str:
    """A histogram of diameters in classes of 4 cm; empty if there are no diameters."""
    classes = Counter(math.floor(100 * value / _CLASS_CM) for value in diameters_m)
    if not classes:
        return ""
    inside = range(min(classes), max(classes) + 1)
    edges = [_edge(_CLASS_CM * index) for index in range(inside.start, inside.stop + 1)]
    counts = [classes[index] for index in inside]
    bars = Bars(counts, [0] * len(counts))
    return bar_chart(name, edges, [bars], unit_html=unit_name(CLASS_EDGE))


def _edge(value_cm: int) -> str:
    return f"<tspan data-bare {length_attributes(CLASS_EDGE, value_cm / 100)}>{value_cm}</tspan>"
