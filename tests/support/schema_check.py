"""Check a JSON object against its schema, with no key that the schema does not name."""

from __future__ import annotations

from typing import Any

from edgetree.schemas import json_schema

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


def check_schema(record: Any) -> str:
    """Raise if a JSON object is not as its schema says; returns the schema's name.

    Without `jsonschema` nothing is checked.
    """
    name: str = record["schema"]
    if jsonschema is not None:
        jsonschema.Draft202012Validator(closed(json_schema(name))).validate(record)
    return name
