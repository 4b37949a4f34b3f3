"""List the constants with their meanings and sources, for the documentation and for the fits."""

from __future__ import annotations

import ast
import inspect
import re
from types import ModuleType
from typing import NamedTuple

from edgetree.measure.constants import circles, depth, edges, ground, outlines, placing, rig, stems

TOPICS = {
    "Stems": stems,
    "Ground and vertical": ground,
    "Keypoints and masks": outlines,
    "Depth": depth,
    "Edges in the depth": edges,
    "Circles in clouds": circles,
    "Rig": rig,
    "Without depth": placing,
}
"""The modules of constants by their headings."""

_DOCSTRING = re.compile(r"(.+?) Source: ((?:fitted \(([\w-]+)\)|chosen|bound|published).*)\.")


class Entry(NamedTuple):
    """One constant.

    Attributes:
        name: Its name, which ends with its unit.
        value: Its value.
        meaning: What it stands for.
        source: Where it comes from.
        fit: Name of the fit that determines it; None if none does.
    """

    name: str
    value: float
    meaning: str
    source: str
    fit: str | None


def entries(module: ModuleType) -> list[Entry]:
    """The constants of one of the modules in `TOPICS`, in their order.

    Raises:
        ValueError: a constant has no docstring that ends with its source.
    """
    found = []
    body = ast.parse(inspect.getsource(module)).body
    for node, after in zip(body, [*body[1:], ast.Pass()], strict=True):
        if not isinstance(node, ast.AnnAssign):
            continue
        name = ast.unparse(node.target)
        text = ast.literal_eval(after.value) if isinstance(after, ast.Expr) else ""
        parts = _DOCSTRING.fullmatch(" ".join(text.split()))
        if parts is None:
            raise ValueError(f"{module.__name__}.{name}: expected a docstring with its source")
        found.append(Entry(name, getattr(module, name), *parts.groups()))
    return found
