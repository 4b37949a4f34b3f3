"""Check JSON objects against their schemas, with no key that the schema does not name."""

from __future__ import annotations

import importlib
import json
from functools import cache
from typing import Any

try:
    import jsonschema
except ImportError:  # in the base install
    jsonschema = None


def closed(schema: Any) -> Any:
    """A schema that allows the keys alone that it names."""
    if isinstance(schema, list):
        return [closed(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    inner = {key: closed(value) for key, value in schema.items()}
    if inner.get("type") == "object" and "properties" in inner:
        inner.setdefault("additionalProperties", False)
    return inner


@cache
def _validator(name: str) -> Any:
    package = "perceptree" if name.startswith("perceptree.") else "edgetree"
    schemas = importlib.import_module(f"{package}.schemas")
    return jsonschema.Draft202012Validator(closed(schemas.json_schema(name)))


def check_schema(record: Any, name: str | None = None) -> str:
    """Raise if a JSON value is not as its schema says; returns the schema's name.

    Without `jsonschema` nothing is checked.

    Args:
        record: The value.
        name: Its schema; what it says itself if None.
    """
    name = record["schema"] if name is None else name
    if jsonschema is not None:
        _validator(name).validate(record)
    return name


def check_printed(arguments: tuple[object, ...], out: str) -> None:
    """Check what a command printed with `--json`; other output is not looked at."""
    if "--json" in arguments and out.startswith("{"):
        for line in out.splitlines():
            check_schema(json.loads(line))
