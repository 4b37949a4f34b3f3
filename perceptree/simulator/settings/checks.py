"""Validation of settings. Error messages state the value and what was expected."""

from __future__ import annotations

import math

from basetree.errors import SettingsError

Range = tuple[float, float]
Shares = dict[str, float]

OMIT_DEFAULT = {"omit_default": True}
"""Metadata of settings that older datasets lack: ``to_dict`` omits them at their default."""


def check_number(name: str, value: float, lowest: float, highest: float) -> None:
    """Check that ``value`` is in [lowest, highest].

    Raises:
        SettingsError: If it is not.
    """
    if not (math.isfinite(value) and lowest <= value <= highest):
        raise SettingsError(f"{name} is {value:g}: expected {lowest:g} to {highest:g}")


def check_range(name: str, value: Range, lowest: float, highest: float) -> None:
    """Check that ``value`` is a range (low, high) within [lowest, highest].

    Raises:
        SettingsError: If it is not.
    """
    low, high = value
    if not lowest <= low <= high <= highest:
        raise SettingsError(
            f"{name} is ({low:g}, {high:g}): expected low <= high, both in"
            f" [{lowest:g}, {highest:g}]"
        )


def check_shares(name: str, value: Shares, known: tuple[str, ...]) -> None:
    """Check that ``value`` has weights of at least 0 for known names, and one above 0.

    Raises:
        SettingsError: If it has not.
    """
    for key, weight in value.items():
        if key not in known:
            raise SettingsError(f"{name} has the name {key!r}: expected one of {', '.join(known)}")
        if not (math.isfinite(weight) and weight >= 0):
            raise SettingsError(f"{name}[{key!r}] is {weight:g}: expected a weight of at least 0")
    if not sum(value.values()) > 0:
        raise SettingsError(f"{name} has no weight above 0: expected at least one")


def check_choice(name: str, value: str, known: tuple[str, ...]) -> None:
    """Check that ``value`` is one of ``known``.

    Raises:
        SettingsError: If it is not.
    """
    if value not in known:
        raise SettingsError(f"{name} is {value!r}: expected one of {', '.join(known)}")
