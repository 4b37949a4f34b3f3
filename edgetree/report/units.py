"""Quantities in the report, which the page's script converts to the units of the reader."""

from __future__ import annotations

import json
from typing import Final

from edgetree.measure import Estimate
from edgetree.results.units import AMOUNTS, Amount

CLASS_EDGE: Final = "class_edge_m"
"""Name in `UNITS` of the edges of diameter classes."""

PROFILE_HEIGHT: Final = "profile_height_m"
"""Name in `UNITS` of the heights of a profile's chart."""

BASAL_AREA: Final = "basal_area_m2_per_ha"
"""Name in `UNITS` of basal areas."""

_DIAMETERS: Final = ("diameter_m", "dbh_m", "cut_height_m", CLASS_EDGE)
_DISTANCES: Final = ("distance_m", "axis_distance_m")
_VOLUMES: Final = ("seen_volume_m3", "volume_m3")
_BASAL_AREA: Final = Amount("basal area", "m²/ha", 1.0, 1)
_PROFILE_HEIGHT: Final = Amount("height", "m", 1.0, 0)


def _millimetres() -> dict[str, Amount]:
    amounts = {name: Amount("", "mm", 1000.0, 0) for name in _DIAMETERS}
    amounts |= {name: AMOUNTS[name] for name in (*_DISTANCES, *_VOLUMES)}
    return {
        **amounts,
        "taper_cm_per_m": Amount("", "mm/m", 10.0, 0),
        PROFILE_HEIGHT: _PROFILE_HEIGHT,
        BASAL_AREA: _BASAL_AREA,
    }


def _inches() -> dict[str, Amount]:
    amounts = {name: Amount("", "in", 1 / 0.0254, 1) for name in _DIAMETERS}
    amounts |= {name: Amount("", "ft", 1 / 0.3048, 1) for name in (*_DISTANCES, PROFILE_HEIGHT)}
    amounts |= {name: Amount("", "ft³", 1 / 0.3048**3, 1) for name in _VOLUMES}
    amounts[BASAL_AREA] = Amount("", "ft²/acre", 4046.8564224 / 10000 / 0.3048**2, 0)
    return {**amounts, "taper_cm_per_m": Amount("", "in/ft", 0.3048 / 2.54, 2)}


UNITS: Final = {
    "cm": {
        **AMOUNTS,
        CLASS_EDGE: Amount("class edge", "cm", 100.0, 0),
        PROFILE_HEIGHT: _PROFILE_HEIGHT,
        BASAL_AREA: _BASAL_AREA,
    },
    "mm": _millimetres(),
    "inch": _inches(),
}
"""How to format each quantity, by the unit that the reader chooses. Pages start with "cm"."""


def length_attributes(quantity: str, value: Estimate | float) -> str:
    """Attributes of an element that the script converts: quantity, value and std in its unit."""
    if isinstance(value, Estimate):
        number, spread = value.value, f' data-std="{float(value.std)!r}"'
    else:
        number, spread = value, ""
    return f'data-quantity="{quantity}" data-value="{float(number)!r}"{spread}'


def tick_text(quantity: str, value_m: float, text: str) -> str:
    """An SVG element that shows a value without its unit."""
    return f"<tspan data-bare {length_attributes(quantity, value_m)}>{text}</tspan>"


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
