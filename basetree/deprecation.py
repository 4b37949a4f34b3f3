"""Old import paths, which go on for one version with a warning."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

__all__ = ["moved_names"]


def moved_names(module: str, new_places: Mapping[str, str]) -> Callable[[str], Any]:
    """Make the `__getattr__` of a module whose names are elsewhere now.

    Args:
        module: Name of the old module.
        new_places: New place of each name, such as "basetree.errors.InputError".

    Returns:
        A function that returns the object of an old name with a DeprecationWarning.
    """

    def find(name: str) -> Any:
        if name not in new_places:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        new = new_places[name]
        warnings.warn(
            f"{module}.{name} is {new} now; the old name goes with the next version",
            DeprecationWarning,
            stacklevel=2,
        )
        place, _, own = new.rpartition(".")
        return getattr(import_module(place), own)

    return find
