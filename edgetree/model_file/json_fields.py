"""Build dataclasses from JSON values, with each field checked against its annotation."""

from __future__ import annotations

import dataclasses
import math
import types
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from edgetree.errors import ModelFileError

__all__ = ["build"]

_T = TypeVar("_T")

_JSON_KINDS: dict[Any, tuple[tuple[type, ...], str]] = {
    bool: ((bool,), "true or false"),
    str: ((str,), "text"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    Mapping: ((dict,), "an object"),
}


def build(kind: type[_T], data: object, where: str) -> _T:
    """Make an instance of the dataclass `kind` from a JSON object.

    Lists become tuples, and objects become the dataclasses in the annotations. Unknown fields are
    ignored, so that newer versions may add fields.

    Args:
        kind: the dataclass.
        data: the decoded JSON value.
        where: name of the object in error messages.

    Raises:
        ModelFileError: a field is missing or has the wrong type.
    """
    if not isinstance(data, dict):
        raise ModelFileError(f"{where} is {_kind_of(data)}: expected an object")
    hints = _hints_of(kind)  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        if field.name in data:
            values[field.name] = _convert(hints[field.name], data[field.name], where, field.name)
        elif field.default is dataclasses.MISSING:
            raise ModelFileError(f"{where} has no field {field.name!r}: expected one")
    return kind(**values)


@cache
def _hints_of(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _convert(hint: Any, value: object, where: str, name: str) -> Any:
    """Convert `value` to the annotated type `hint`."""
    here = f"{where}: {name}"
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return build(hint, value, here)
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return _convert_union(arguments, value, where, name)
    if origin is tuple:
        return _convert_tuple(arguments, value, where, name)
    kinds, expected = _JSON_KINDS[origin or hint]
    if not isinstance(value, kinds) or (isinstance(value, bool) and hint is not bool):
        raise ModelFileError(f"{here} is {_kind_of(value)}: expected {expected}")
    return _finite(value, here) if hint is float else value


def _finite(value: Any, here: str) -> float:
    """A JSON number as a float; JSON's whole numbers may be larger than any float."""
    with suppress(OverflowError):
        if math.isfinite(value):
            return float(value)
    raise ModelFileError(f"{here} is {_kind_of(value)}: expected a finite number")


def _convert_union(arguments: tuple[Any, ...], value: object, where: str, name: str) -> Any:
    if value is None and types.NoneType in arguments:
        return None
    options = [argument for argument in arguments if argument is not types.NoneType]
    for option in options[:-1]:
        try:
            return _convert(option, value, where, name)
        except ModelFileError:
            continue
    return _convert(options[-1], value, where, name)


def _convert_tuple(arguments: tuple[Any, ...], value: object, where: str, name: str) -> Any:
    here = f"{where}: {name}"
    if not isinstance(value, list):
        raise ModelFileError(f"{here} is {_kind_of(value)}: expected a list")
    if arguments[-1] is Ellipsis:
        arguments = (arguments[0],) * len(value)
    if len(arguments) != len(value):
        raise ModelFileError(f"{here} has {len(value)} items: expected {len(arguments)}")
    pairs = zip(arguments, value, strict=True)
    return tuple(
        _convert(hint, item, where, f"{name}[{index}]") for index, (hint, item) in enumerate(pairs)
    )


def _kind_of(value: object) -> str:
    return f"{value!r}" if isinstance(value, str | int | float) else type(value).__name__
