"""Formatting of measured values: names, units and digits."""

from __future__ import annotations

from typing import Final, NamedTuple

from edgetree.measure import Estimate, Failure


class Amount(NamedTuple):
    """How to format a quantity.

    Attributes:
        name: Name of the quantity.
        unit: Unit of the text.
        per_unit: Factor from the measurement's unit to `unit`.
        digits: Digits after the decimal point.
    """

    name: str
    unit: str
    per_unit: float
    digits: int

    def value(self, estimate: Estimate) -> str:
        """The value without its unit, such as "31.2"."""
        return f"{estimate.value * self.per_unit:.{self.digits}f}"

    def with_std(self, estimate: Estimate, sign: str = " ± ") -> str:
        """The value with one standard deviation, such as "31.2 ± 0.8 cm".

        A standard deviation that would be rounded to zero is shown as the last digit's unit.
        """
        least = 10.0**-self.digits
        std = max(estimate.std * self.per_unit, least)
        unit = self.unit if self.unit == "°" else f" {self.unit}"
        return f"{self.value(estimate)}{sign}{std:.{self.digits}f}{unit}"


AMOUNTS: Final = {
    "diameter_m": Amount("diameter", "cm", 100.0, 1),
    "dbh_m": Amount("DBH", "cm", 100.0, 1),
    "cut_height_m": Amount("cut height", "cm", 100.0, 0),
    "inclination_deg": Amount("lean", "°", 1.0, 1),
    "distance_m": Amount("distance", "m", 1.0, 2),
    "axis_distance_m": Amount("axis distance", "m", 1.0, 2),
    "taper_cm_per_m": Amount("taper", "cm/m", 1.0, 1),
    "seen_volume_m3": Amount("seen volume", "m³", 1.0, 3),
    "volume_m3": Amount("stem volume", "m³", 1.0, 3),
}
"""The quantities in tables and labels, in this order."""

_SECTORS: Final = (
    "away",
    "away, right",
    "right",
    "towards, right",
    "towards",
    "towards, left",
    "left",
    "away, left",
)


def direction_words(lean: Estimate | Failure, direction: Estimate | Failure) -> str:
    """Direction of a stem's lean as seen from the camera, such as "towards, left".

    Empty if the lean is not known or not significantly different from zero.
    """
    if isinstance(lean, Failure) or isinstance(direction, Failure) or lean.interval95[0] <= 0:
        return ""
    return _SECTORS[round(direction.value / 45) % len(_SECTORS)]
