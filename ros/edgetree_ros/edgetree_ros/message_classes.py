"""Messages of the classes that ROS generates, for the code that edgetree's bags are made by."""

from __future__ import annotations

from array import array
from importlib import import_module
from typing import Any

import numpy as np

_ARRAY_TYPES = {"double": "d", "float": "f", "uint8": "B"}


def new_message(package: str, name: str, *values: Any) -> Any:
    """A message of `package/msg/name` with the values of its fields, in their order."""
    kind = getattr(import_module(f"{package}.msg"), name)
    types = kind.get_fields_and_field_types()
    if len(types) != len(values):
        raise TypeError(
            f"{package}/msg/{name} has the fields {', '.join(types)}: expected {len(values)} of"
            " them, as in ROS 2 Humble"
        )
    fields = zip(types.items(), values, strict=True)
    return kind(**{field: _fitting(value, words) for (field, words), value in fields})


def _fitting(value: Any, words: str) -> Any:
    """A value as the generated classes take it for a field of a type, such as "sequence<uint8>"."""
    if words == "octet":
        return bytes([value])
    if isinstance(value, np.ndarray) and words.startswith("sequence<"):
        element = words.removeprefix("sequence<").removesuffix(">")
        return array(_ARRAY_TYPES[element], value.tobytes())
    return value
