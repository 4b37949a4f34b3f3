"""The docstrings of settings, which Python does not keep, from their source."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from functools import cache
from itertools import pairwise


@cache
def field_words(settings: type) -> Mapping[str, str]:
    """The docstring below each field of a dataclass, on one line.

    Fields without one are left out, as are all of a program that is packed without its source.
    """
    words: dict[str, str] = {}
    for base in reversed(settings.__mro__):
        if is_dataclass(base):
            words |= _module_words(base.__module__).get(base.__name__, {})
    return words


@cache
def _module_words(module: str) -> Mapping[str, Mapping[str, str]]:
    """The docstrings below the fields of each class of a module."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except OSError:
        return {}
    return {node.name: dict(_pairs(node)) for node in tree.body if isinstance(node, ast.ClassDef)}


def _pairs(node: ast.ClassDef) -> Iterator[tuple[str, str]]:
    for field, below in pairwise(node.body):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            text = ast.get_docstring(ast.Module([below], []))
            if text is not None:
                yield field.target.id, " ".join(text.split())
