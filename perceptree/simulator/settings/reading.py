"""Settings from a JSON file: the whole tree or the few values that differ."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any, TypeVar

from basetree.errors import SettingsError
from basetree.files.regular import read_regular
from perceptree.simulator.settings.tree import SimulatorSettings

Node = TypeVar("Node")


def read_settings(path: Path, start: SimulatorSettings) -> SimulatorSettings:
    """Read settings from a file.

    Args:
        path: A JSON object of changed settings, such as
            `{"stand": {"stems_per_ha": [400, 500]}}`, or the `settings.json` of a dataset.
        start: What the changes are applied to. The record of a dataset is complete and does not
            use it: what it leaves out was off.

    Raises:
        SettingsError: If the file cannot be read, or a name or value is wrong.
    """
    try:
        values = json.loads(read_regular(path))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{path}: not JSON ({error})") from error
    if isinstance(values, dict) and "sha256" in values:
        start, values = SimulatorSettings(), values.get("settings")
    try:
        return _changed(start, values, "")
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error


def _changed(node: Node, values: Any, name: str) -> Node:
    """A dataclass with the values named, its own dataclasses changed likewise."""
    if not isinstance(values, dict):
        raise SettingsError(f"{name or 'the file'} is {values!r}: expected an object of settings")
    known = [field.name for field in dataclasses.fields(node)]  # type: ignore[arg-type]
    changes = {}
    for key, value in values.items():
        if key not in known:
            raise SettingsError(f"{name}{key} is no setting: expected some of {', '.join(known)}")
        changes[key] = _value(getattr(node, key), value, f"{name}{key}")
    return dataclasses.replace(node, **changes)  # type: ignore[type-var]


def _value(now: Any, value: Any, name: str) -> Any:
    """A value of the kind that the setting has now."""
    if dataclasses.is_dataclass(now):
        return _changed(now, value, f"{name}.")
    if isinstance(now, str):
        if not isinstance(value, str):
            raise SettingsError(f"{name} is {value!r}: expected a word")
        return value
    if isinstance(now, tuple):
        if not isinstance(value, list) or not all(_is_number(part) for part in value):
            raise SettingsError(f"{name} is {value!r}: expected a list of numbers")
        if now and len(value) != len(now):
            raise SettingsError(f"{name} is {value!r}: expected {len(now)} numbers")
        return tuple(value)
    if isinstance(now, dict):
        if not isinstance(value, dict) or not all(_is_number(part) for part in value.values()):
            raise SettingsError(f"{name} is {value!r}: expected an object of weights")
        return value
    return _number(now, value, name)


def _number(now: Any, value: Any, name: str) -> Any:
    """A number, or true or false; None stands for a number that is not stated."""
    if now is None:
        if value is not None and not _is_number(value):
            raise SettingsError(f"{name} is {value!r}: expected a number, or null for none")
        return value
    if isinstance(now, bool) != isinstance(value, bool) or not (
        isinstance(value, bool) or _is_number(value)
    ):
        expected = "true or false" if isinstance(now, bool) else "a number"
        raise SettingsError(f"{name} is {value!r}: expected {expected}")
    if isinstance(now, int) and int(value) != value:
        raise SettingsError(f"{name} is {value!r}: expected a whole number")
    return type(now)(value)


def _is_number(value: Any) -> bool:
    """Whether a value is a finite number that a float can hold."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) <= sys.float_info.max
