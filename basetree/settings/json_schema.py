"""JSON Schema of settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from basetree.settings.base import metadata_of
from basetree.settings.words import field_words

_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string", Path: "string"}


def json_schema(settings: type) -> dict[str, Any]:
    """Describe a JSON file that changes settings, in JSON Schema (2020-12).

    Every setting may be left out. Conditions on several settings together are not part of it.

    Args:
        settings: A dataclass; its fields may be dataclasses, tuples of numbers, and dictionaries of
            weights.
    """
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_object(settings)}


def _object(settings: type) -> dict[str, Any]:
    hints, words = get_type_hints(settings), field_words(settings)
    properties = {}
    for entry in fields(settings):
        values = _values(hints[entry.name], metadata_of(settings, entry))
        described = {"description": words[entry.name]} if entry.name in words else {}
        properties[entry.name] = values | described | _default(entry)
    about = " ".join((settings.__doc__ or "").partition("\n\n")[0].split())
    rest = {"properties": properties, "additionalProperties": False}
    return {"type": "object", "description": about, **rest}


def _values(hint: Any, rule: Mapping[str, Any]) -> dict[str, Any]:
    """The keywords for the values of a type that follow a rule."""
    if is_dataclass(hint) and isinstance(hint, type):
        return _object(hint)
    if get_origin(hint) in (Union, UnionType):
        (other,) = (each for each in get_args(hint) if each is not NoneType)
        return {"anyOf": [_values(other, rule), {"type": "null"}]}
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is tuple:
        count = len(arguments)
        length = {} if Ellipsis in arguments else {"minItems": count, "maxItems": count}
        return {"type": "array", "items": _values(arguments[0], rule), **length}
    if origin is dict:
        weight, names = {"type": _TYPES[arguments[1]], "minimum": 0}, {"enum": [*rule["weights"]]}
        return {"type": "object", "additionalProperties": weight, "propertyNames": names}
    if origin is Literal or "names" in rule:
        return {"enum": list(rule.get("names", arguments))}
    return {"type": _TYPES[hint], **rule.get("bounds", {})}


def _default(entry: Field[Any]) -> dict[str, Any]:
    made = entry.default if entry.default_factory is MISSING else entry.default_factory()
    return {} if made is MISSING or is_dataclass(made) else {"default": made}
