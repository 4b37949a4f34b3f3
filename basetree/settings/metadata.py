"""The metadata of a setting: its rule, its name in messages, and its option."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Any, Protocol

__all__ = [
    "NOT_AN_OPTION",
    "Metadata",
    "Rule",
    "choice",
    "label",
    "limits",
    "option",
    "pair",
    "weights",
]

_LARGEST = sys.float_info.max

Metadata = dict[str, Any]
"""Metadata of a field of a dataclass; several are joined by ``|``."""

NOT_AN_OPTION: Metadata = {"option": None}
"""Metadata of a setting that the command line does not offer."""


class Rule(Protocol):
    """What a value may be."""

    @property
    def expected(self) -> str:
        """The valid values in words."""

    def complaint(self, name: str, value: Any) -> tuple[str, str] | None:
        """What is wrong with a value and what is expected; None if it is valid."""

    def schema(self) -> dict[str, Any]:
        """The rule in the keywords of JSON Schema."""


def option(*names: str, metavar: str | None = None) -> Metadata:
    """Name the option of a setting, where the name of its field does not do.

    Args:
        *names: Such as "--certain", or "--frozen-norms/--trained-norms"; none keeps the field's.
        metavar: Name of the option's value in the help.
    """
    return {"option": (names, metavar)}


def label(name: str) -> Metadata:
    """Name a setting in messages, where the name of its field does not do."""
    return {"label": name}


def limits(
    least: float = -inf,
    most: float = inf,
    *,
    over: float | None = None,
    under: float | None = None,
    expected: str = "",
    unit: str = "",
    style: str = "",
    whole: bool = False,
) -> Metadata:
    """Limit a number, which must be finite in any case.

    Args:
        least: Smallest value.
        most: Largest value.
        over: The value must be over this, in place of ``least``.
        under: The value must be under this, in place of ``most``.
        expected: The limits in words, for messages and help; by default from the numbers.
        unit: Unit of the value in messages, if the name does not tell it.
        style: Format of the value in messages.
        whole: Whether the value must be an integer.
    """
    low, high = least if over is None else over, most if under is None else under
    is_over, is_under = over is not None, under is not None
    words = expected or _words(low, high, is_over, is_under)
    return {"rule": _Number(low, high, words, is_over, is_under, whole, style, unit)}


def pair(
    least: float,
    most: float = inf,
    *,
    over: bool = False,
    is_ascending: bool = True,
    expected: str = "",
    style: str = "",
) -> Metadata:
    """Limit two numbers (low, high).

    Args:
        least: Smallest value.
        most: Largest value.
        over: Whether ``least`` itself is too small.
        is_ascending: Whether low must not be above high.
        expected: As for :func:`limits`.
        style: As for :func:`limits`.
    """
    words = expected or f"low <= high, both in [{least:g}, {most:g}]"
    bounds = _Number(least, most, words, over, style=style)
    return {"rule": _Pair(bounds, words, is_ascending)}


def weights(names: Iterable[str]) -> Metadata:
    """Expect weights by name.

    Args:
        names: The names that are known.
    """
    known = tuple(names)
    return {"rule": _Weights(known, f"weights of {', '.join(known)}")}


def choice(names: Iterable[str], expected: str = "") -> Metadata:
    """Expect one of several names.

    Args:
        names: The names.
        expected: As for :func:`limits`.
    """
    known = tuple(names)
    return {"rule": _Choice(known, expected or f"one of {', '.join(known)}")}


def _words(low: float, high: float, is_over: bool, is_under: bool) -> str:
    if low > -inf and high < inf and not (is_over or is_under):
        return f"{low:g} to {high:g}"
    least = f"{'over' if high < inf else 'more than'} {low:g}" if is_over else f"at least {low:g}"
    most = f"under {high:g}" if is_under else f"at most {high:g}"
    return ", ".join([least] * (low > -inf) + [most] * (high < inf))


@dataclass(frozen=True)
class _Number:
    """A finite number between two limits."""

    least: float
    most: float
    expected: str
    is_over: bool = False
    is_under: bool = False
    whole: bool = False
    style: str = ""
    unit: str = ""

    def accepts(self, value: Any) -> bool:
        """Whether a number is within the limits."""
        above = self.least < value if self.is_over else self.least <= value
        below = value < self.most if self.is_under else value <= self.most
        return bool(above and below and -_LARGEST <= value <= _LARGEST)

    def complaint(self, name: str, value: Any) -> tuple[str, str] | None:
        found = f"{name} is {value:{self.style}}{' ' * bool(self.unit)}{self.unit}"
        if self.whole and not isinstance(value, int):
            return found, f"an integer, {self.expected}"
        return None if self.accepts(value) else (found, self.expected)

    def schema(self) -> dict[str, Any]:
        least = "exclusiveMinimum" if self.is_over else "minimum"
        most = "exclusiveMaximum" if self.is_under else "maximum"
        bounds = {least: self.least, most: self.most}
        return {name: bound for name, bound in bounds.items() if abs(bound) < inf}


@dataclass(frozen=True)
class _Pair:
    """Two numbers between the same limits."""

    bounds: _Number
    expected: str
    is_ascending: bool = True

    def complaint(self, name: str, value: Any) -> tuple[str, str] | None:
        low, high = value
        fits = all(map(self.bounds.accepts, value)) and (low <= high or not self.is_ascending)
        style = self.bounds.style
        return None if fits else (f"{name} is ({low:{style}}, {high:{style}})", self.expected)

    def schema(self) -> dict[str, Any]:
        return {"items": {"type": "number", **self.bounds.schema()}}


@dataclass(frozen=True)
class _Weights:
    """Weights of at least 0 by name, one of them above 0."""

    names: tuple[str, ...]
    expected: str

    def complaint(self, name: str, value: Any) -> tuple[str, str] | None:
        for key, weight in value.items():
            if key not in self.names:
                return f"{name} has the name {key!r}", f"one of {', '.join(self.names)}"
            if not 0 <= weight <= _LARGEST:
                return f"{name}[{key!r}] is {weight:g}", "a weight of at least 0"
        has_weight = sum(value.values()) > 0
        return None if has_weight else (f"{name} has no weight above 0", "at least one")

    def schema(self) -> dict[str, Any]:
        weight = {"type": "number", "minimum": 0}
        return {"propertyNames": {"enum": list(self.names)}, "additionalProperties": weight}


@dataclass(frozen=True)
class _Choice:
    """One of several names."""

    names: tuple[str, ...]
    expected: str

    def complaint(self, name: str, value: Any) -> tuple[str, str] | None:
        return None if value in self.names else (f"{name} is {value!r}", self.expected)

    def schema(self) -> dict[str, Any]:
        return {"enum": list(self.names)}
