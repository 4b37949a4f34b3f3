"""An extension of griffe: the reference shows the default of a dataclass field, not its call."""

from __future__ import annotations

from typing import Any

import griffe


class FieldDefaults(griffe.Extension):
    """Replace `field(default=VALUE, metadata=...)` by `VALUE` in what is shown."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Called by griffe once a package is read and its dataclasses have their parameters."""
        _simplify(pkg)


def _simplify(place: griffe.Module | griffe.Class) -> None:
    for member in place.members.values():
        if isinstance(member, griffe.Module | griffe.Class):
            _simplify(member)
        elif isinstance(member, griffe.Attribute) and _is_field(member.value):
            member.value = _default(member.value)


def _is_field(value: Any) -> bool:
    return isinstance(value, griffe.ExprCall) and value.canonical_path == "dataclasses.field"


def _default(call: griffe.ExprCall) -> Any:
    """What stands in `default` or `default_factory`; None, which shows no value, without them."""
    for argument in call.arguments:
        if isinstance(argument, griffe.ExprKeyword):
            if argument.name == "default":
                return argument.value
            if argument.name == "default_factory":
                return f"{argument.value}()"
    return None
