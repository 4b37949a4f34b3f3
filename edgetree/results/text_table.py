"""Measurements as a text table for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import wrap
from typing import Final

from edgetree.measure import Estimate, Evidence, Failure, TreeMeasurement
from edgetree.results.units import AMOUNTS, direction_words

__all__ = ["failure_reasons", "table_lines"]

_WIDTHS: Final = {
    "diameter_m": 16,
    "dbh_m": 16,
    "cut_height_m": 14,
    "inclination_deg": 28,
    "distance_m": 0,
}
_LINE: Final = 100
_INDENT: Final = " " * 6


def table_lines(measurements: list[TreeMeasurement], numbers: tuple[int, ...]) -> Iterator[str]:
    """The lines of the table.

    Each tree has a row, followed by its failures, its warnings and the evidence.

    Args:
        measurements: the measurement of each tree.
        numbers: the number of each tree.
    """
    if not measurements:
        yield "no trees"
        return
    yield _row("tree", {name: AMOUNTS[name].name for name in _WIDTHS})
    for number, tree in zip(numbers, measurements, strict=True):
        yield _row(f"{number:4}", {name: _cell(tree, name) for name in _WIDTHS})
        notes = [f"{what}: {reason}" for what, reason in failure_reasons(tree)]
        notes += [f"warning: {text}" for text in tree.evidence.warnings]
        ground = tree.evidence.ground
        if ground and not any(ground in text for text in notes):
            notes.append(f"ground: {ground}")
        if tree.evidence.method:
            notes.append(_evidence(tree.evidence))
        for text in notes:
            yield from wrap(text, _LINE, initial_indent=_INDENT, subsequent_indent=_INDENT + "  ")
    yield "± is one standard deviation; twice that holds the truth for 95 trees in 100"


def _row(first: str, cells: dict[str, str]) -> str:
    parts = (f"{text:<{_WIDTHS[name]}}" for name, text in cells.items())
    return f"{first}  {''.join(parts)}".rstrip()


def _cell(tree: TreeMeasurement, quantity: str) -> str:
    result: Estimate | Failure = getattr(tree, quantity)
    if isinstance(result, Failure):
        return "–"
    text = AMOUNTS[quantity].with_std(result)
    if quantity == "inclination_deg":
        text = f"{text} {direction_words(result, tree.lean_direction_deg)}"
    return text


def failure_reasons(tree: TreeMeasurement) -> Iterator[tuple[str, str]]:
    """The quantities that could not be measured, grouped by reason, such as ("no DBH", reason)."""
    missing: dict[str, list[str]] = {}
    for quantity, amount in AMOUNTS.items():
        result: Estimate | Failure = getattr(tree, quantity)
        if isinstance(result, Failure):
            missing.setdefault(result.reason, []).append(amount.name)
    for reason, names in missing.items():
        yield "not measured" if len(names) == len(AMOUNTS) else f"no {', '.join(names)}", reason


def _evidence(evidence: Evidence) -> str:
    shown = evidence.visible_share
    visible = "" if shown is None else f"{shown:.0%} of the stem visible, "
    return (
        f"from {evidence.method}; {visible}depth at {evidence.valid_depth_share:.0%} of it,"
        f" an arc of {evidence.arc_deg:.0f}° seen"
    )
