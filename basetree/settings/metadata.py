"""The metadata of a setting: what it may be, its name in messages, and its option."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from math import inf
from typing import Any

_LARGEST = sys.float_info.max

Metadata = dict[str, Any]
"""Metadata of a field of a dataclass; several are joined by `|`."""

NOT_AN_OPTION: Metadata = {"option": None}
"""Metadata of a setting that the command line does not offer."""

UNORDERED: Metadata = {"unordered": True}
"""Metadata of two numbers of which the first may be the larger one."""


def option(*names: str, metavar: str | None = None) -> Metadata:
    """Name the option of a setting, and its value in the help, where the field's name does not."""
    return {"option": (names, metavar)}


def shown_default(words: str) -> Metadata:
    """Say in the help what a setting is if it is not given, where its default does not."""
    return {"shown_default": words}


def label(name: str) -> Metadata:
    """Name a setting in messages, where the name of its field does not do."""
    return {"label": name}


def names(known: Iterable[str], expected: str = "") -> Metadata:
    """Expect one of several names.

    Args:
        known: The names.
        expected: The names in words, for messages and help.
    """
    known = tuple(known)
    return {"names": known, "expected": expected or f"one of {', '.join(known)}"}


def weights(known: Iterable[str]) -> Metadata:
    """Expect a dictionary of weights by these names, at least one of them above 0."""
    return {"weights": tuple(known)}


def limits(
    least: float = -inf,
    most: float = inf,
    *,
    over: float = -inf,
    under: float = inf,
    expected: str = "",
    style: str = "",
    unit: str = "",
    whole: bool = False,
) -> Metadata:
    """Limit a finite number, or both numbers of a range (low, high) with low <= high.

    Args:
        least: Smallest value.
        most: Largest value.
        over: Value that all must be above.
        under: Value that all must be below.
        expected: The limits in words, for messages and help; by default from the numbers.
        style: Format of the value in messages.
        unit: Unit of the value in messages, if the name does not tell it.
        whole: Whether the value must be an integer.
    """
    bounds = {"minimum": least, "maximum": most}
    bounds |= {"exclusiveMinimum": over, "exclusiveMaximum": under}
    return {
        "bounds": {name: bound for name, bound in bounds.items() if abs(bound) < inf},
        "expected": expected or _words(least, most, over, under),
        "expected_range": expected or f"low <= high, both in [{least:g}, {most:g}]",
        "style": style,
        "unit": f" {unit}" if unit else "",
        "whole": whole,
    }


def complaint(name: str, value: Any, rule: Mapping[str, Any]) -> tuple[str, str] | None:
    """What is found and what is expected instead; None if the value is valid.

    Args:
        name: Name of the value.
        value: The value.
        rule: What it may be, as `limits`, `names` or `weights` return it; empty for anything.
    """
    if "weights" in rule:
        return _complaint_of_weights(name, value, rule["weights"])
    if "names" in rule:
        return None if value in rule["names"] else (f"{name} is {value!r}", rule["expected"])
    if "bounds" not in rule:
        return None
    style, expected = rule["style"], rule["expected"]
    if isinstance(value, tuple):
        low, high = value
        fits = _fits(low, rule) and _fits(high, rule) and (low <= high or "unordered" in rule)
        shown, expected = f"({low:{style}}, {high:{style}})", rule["expected_range"]
    else:
        fits, shown = _fits(value, rule), f"{value:{style}}"
        if rule["whole"] and not isinstance(value, int):
            fits, expected = False, f"an integer, {expected}"
    return None if fits else (f"{name} is {shown}{rule['unit']}", expected)


def _fits(number: Any, rule: Mapping[str, Any]) -> bool:
    bounds = rule["bounds"]
    least, most = bounds.get("minimum", -_LARGEST), bounds.get("maximum", _LARGEST)
    over, under = bounds.get("exclusiveMinimum", -inf), bounds.get("exclusiveMaximum", inf)
    return bool(least <= number <= most and over < number < under)


def _complaint_of_weights(
    name: str, weights: Mapping[str, float], known: tuple[str, ...]
) -> tuple[str, str] | None:
    for key, weight in weights.items():
        if key not in known:
            return f"{name} has the name {key!r}", f"one of {', '.join(known)}"
        if not 0 <= weight <= _LARGEST:
            return f"{name}[{key!r}] is {weight:g}", "a weight of at least 0"
    has_weight = sum(weights.values()) > 0
    return None if has_weight else (f"{name} has no weight above 0", "at least one")


def _words(least: float, most: float, over: float, under: float) -> str:
    if least > -inf and most < inf:
        return f"{least:g} to {most:g}"
    parts = {
        f"at least {least:g}": least > -inf,
        f"{'over' if most < inf else 'more than'} {over:g}": over > -inf,
        f"at most {most:g}": most < inf,
        f"under {under:g}": under < inf,
    }
    return ", ".join(words for words, applies in parts.items() if applies)
