"""Measured values in the words and units of people who fell trees."""

from __future__ import annotations

from typing import Final, NamedTuple

from edgetree.measure import Estimate, Failure

__all__ = ["AMOUNTS", "Amount", "direction_words"]


class Amount(NamedTuple):
    """How a quantity of a measurement is written: its name, and its unit for people."""

    name: str
    unit: str
    per_unit: float
    digits: int

    def value(self, estimate: Estimate) -> str:
        """The number alone, such as "31.2"."""
        return f"{estimate.value * self.per_unit:.{self.digits}f}"

    def with_std(self, estimate: Estimate, sign: str = " ± ") -> str:
        """With one standard deviation, such as "31.2 ± 0.8 cm"; none is called zero."""
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
}
"""The quantities shown to people, in the order of tables."""

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
    """Where a stem leans to as the camera sees it; nothing where it may as well stand upright."""
    if isinstance(lean, Failure) or isinstance(direction, Failure) or lean.interval95[0] <= 0:
        return ""
    return _SECTORS[round(direction.value / 45) % len(_SECTORS)]
