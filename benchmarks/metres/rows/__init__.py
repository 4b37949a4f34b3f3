"""Rows of scenes by name. Each draws a scene and yields measurements with their true values."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import numpy as np

from edgetree.measure import TreeMeasurement

Row = Callable[[np.random.Generator], Iterable[tuple[TreeMeasurement, dict[str, Any]]]]

ROWS: dict[str, Row] = {
    name: row
    for module in iter_modules(__path__)
    for name, row in import_module(f"{__name__}.{module.name}").ROWS.items()
}
"""All rows of the modules beside this file, each with a dictionary `ROWS`."""
