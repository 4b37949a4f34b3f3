"""Read and write JSON: texts without repeated keys, files of one schema, and dataclasses."""

from __future__ import annotations

import dataclasses
import json
import math
import types
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NoReturn, TypeVar, Union, get_args, get_origin, get_type_hints

from basetree.errors import InputError

_T = TypeVar("_T")

_JSON_KINDS: dict[Any, tuple[tuple[type, ...], str]] = {
    bool: ((bool,), "true or false"),
    str: ((str,), "text"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    Mapping: ((dict,), "an object"),
}


def refuse_repeated(names: Iterable[str]) -> None:
    """Raise ValueError if a name is repeated."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ValueError(f"{name} is given twice")
        seen.add(name)


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a JSON object of its pairs; ValueError if a key is repeated."""
    found = dict(pairs)
    if len(found) != len(pairs):
        refuse_repeated(name for name, _ in pairs)
    return found


def parse_json(text: str) -> Any:
    """Parse a JSON text in which no key may be repeated, and numbers are finite.

    Raises:
        ValueError: If it is another text.
        RecursionError: If it is nested too deeply.
    """
    return json.loads(text, object_pairs_hook=unique_keys, parse_constant=_refuse_constant)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def read_json(path: Path, schema: str, expected: str) -> dict[str, Any]:
    """Read a file with one JSON object of this project.

    Args:
        path: The file.
        schema: Value of its field "schema".
        expected: What the file should be, for messages.

    Raises:
        InputError: If the file cannot be read, is not JSON, or has another schema.
    """
    expected = f"expected {expected}, schema {schema}"
    try:
        values = parse_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): {expected}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} cannot be read, it is not JSON ({error}): {expected}") from error
    found = values.get("schema") if isinstance(values, dict) else type(values).__name__
    if found != schema:
        raise InputError(f"{path} has the schema {found!r}: {expected}")
    return dict(values)


def json_text(schema: str, values: Mapping[str, Any]) -> str:
    """The text of a file of this project: a JSON object with its schema first."""
    return json.dumps({"schema": schema, **values}, indent=1) + "\n"


def build(kind: type[_T], data: object, where: str) -> _T:
    """Make an instance of the dataclass `kind` from a JSON object.

    Lists become tuples, and objects become the dataclasses in the annotations. Unknown fields are
    ignored, so that newer versions may add fields.

    Args:
        kind: The dataclass.
        data: The decoded JSON value.
        where: Name of the object in error messages.

    Raises:
        InputError: If a field is missing or has the wrong type.
    """
    if not isinstance(data, dict):
        raise InputError(f"{where} is {_kind_of(data)}: expected an object")
    hints = _hints_of(kind)  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        if field.name in data:
            values[field.name] = _convert(hints[field.name], data[field.name], where, field.name)
        elif field.default is dataclasses.MISSING:
            raise InputError(f"{where} has no field {field.name!r}: expected one")
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
        raise InputError(f"{here} is {_kind_of(value)}: expected {expected}")
    return _finite(value, here) if hint is float else value


def _finite(value: Any, here: str) -> float:
    """A JSON number as a float; JSON's whole numbers may be larger than any float."""
    with suppress(OverflowError):
        if math.isfinite(value):
            return float(value)
    raise InputError(f"{here} is {_kind_of(value)}: expected a finite number")


def _convert_union(arguments: tuple[Any, ...], value: object, where: str, name: str) -> Any:
    if value is None and types.NoneType in arguments:
        return None
    options = [argument for argument in arguments if argument is not types.NoneType]
    for option in options[:-1]:
        try:
            return _convert(option, value, where, name)
        except InputError:
            continue
    return _convert(options[-1], value, where, name)


def _convert_tuple(arguments: tuple[Any, ...], value: object, where: str, name: str) -> Any:
    here = f"{where}: {name}"
    if not isinstance(value, list):
        raise InputError(f"{here} is {_kind_of(value)}: expected a list")
    if arguments[-1] is Ellipsis:
        arguments = (arguments[0],) * len(value)
    if len(arguments) != len(value):
        raise InputError(f"{here} has {len(value)} items: expected {len(arguments)}")
    pairs = zip(arguments, value, strict=True)
    return tuple(
        _convert(hint, item, where, f"{name}[{index}]") for index, (hint, item) in enumerate(pairs)
    )


def _kind_of(value: object) -> str:
    return f"{value!r}" if isinstance(value, str | int | float) else type(value).__name__
