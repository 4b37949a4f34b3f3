"""Lengths in the report, which the page's script converts to the unit that the reader chooses."""

from __future__ import annotations

import json
from typing import Final

from edgetree.measure import Estimate
from edgetree.results.units import AMOUNTS, Amount

__all__ = ["CLASS_EDGE", "UNITS", "length_attributes", "unit_buttons", "unit_name"]

CLASS_EDGE: Final = "class_edge_m"
"""Name in `UNITS` of the edges of diameter classes."""


def _in(unit: str, per_m: float, digits: int, distance: Amount) -> dict[str, Amount]:
    """All lengths in one unit, except for the distance."""
    names = ("diameter_m", "dbh_m", "cut_height_m", CLASS_EDGE)
    amounts = {name: Amount(name.removesuffix("_m"), unit, per_m, digits) for name in names}
    return {**amounts, "distance_m": distance}


UNITS: Final = {
    "cm": {**AMOUNTS, CLASS_EDGE: Amount("class edge", "cm", 100.0, 0)},
    "mm": _in("mm", 1000.0, 0, AMOUNTS["distance_m"]),
    "inch": _in("in", 1 / 0.0254, 1, Amount("distance", "ft", 1 / 0.3048, 1)),
}
"""How to format each length, by the unit that the reader chooses. Pages start with "cm"."""


def length_attributes(quantity: str, value: Estimate | float) -> str:
    """Attributes of an element whose text is a length: quantity, value and std in metres."""
    if isinstance(value, Estimate):
        number, spread = value.value, f' data-std="{float(value.std)!r}"'
    else:
        number, spread = value, ""
    return f'data-quantity="{quantity}" data-value="{float(number)!r}"{spread}'


def unit_name(quantity: str) -> str:
    """An SVG element that shows the unit of a quantity."""
    return f'<tspan data-quantity="{quantity}">{UNITS["cm"][quantity].unit}</tspan>'


def unit_buttons() -> str:
    """The buttons that choose the unit, and the units for the script."""
    table = {
        choice: {name: amount[1:] for name, amount in amounts.items()}
        for choice, amounts in UNITS.items()
    }
    buttons = "".join(
        f'<button type="button" value="{choice}" aria-pressed="{str(choice == "cm").lower()}">'
        f"{choice}</button>"
        for choice in UNITS
    )
    return (
        f'<div class="units" role="group" aria-label="unit"><span>Unit</span> {buttons}</div>'
        f'<script type="application/json" id="units">{json.dumps(table)}</script>'
    )
