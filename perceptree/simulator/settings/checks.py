"""Checks shared by the settings: a value out of bounds is named with its bounds."""

from __future__ import annotations

import math

from perceptree.errors import SettingsError

Range = tuple[float, float]
Shares = dict[str, float]

LATER = {"later": True}
"""Metadata of a setting that older data sets do not know: it is told only where it is changed."""


def check_number(name: str, value: float, lowest: float, highest: float) -> None:
    """Raise SettingsError unless ``value`` lies in [lowest, highest]."""
    if not (math.isfinite(value) and lowest <= value <= highest):
        raise SettingsError(f"{name} is {value:g}: expected {lowest:g} to {highest:g}")


def check_range(name: str, value: Range, lowest: float, highest: float) -> None:
    """Raise SettingsError unless ``value`` is (low, high) within [lowest, highest]."""
    low, high = value
    if not lowest <= low <= high <= highest:
        raise SettingsError(
            f"{name} is ({low:g}, {high:g}): expected low <= high, both in"
            f" [{lowest:g}, {highest:g}]"
        )


def check_shares(name: str, value: Shares, known: tuple[str, ...]) -> None:
    """Raise SettingsError unless ``value`` gives known names weights >= 0, not all of them 0."""
    for key, weight in value.items():
        if key not in known:
            raise SettingsError(f"{name} names {key!r}: expected some of {', '.join(known)}")
        if not (math.isfinite(weight) and weight >= 0):
            raise SettingsError(f"{name}[{key!r}] is {weight:g}: expected a weight of at least 0")
    if not sum(value.values()) > 0:
        raise SettingsError(f"{name} has no weight above 0: expected at least one")


def check_choice(name: str, value: str, known: tuple[str, ...]) -> None:
    """Raise SettingsError unless ``value`` is one of ``known``."""
    if value not in known:
        raise SettingsError(f"{name} is {value!r}: expected one of {', '.join(known)}")
