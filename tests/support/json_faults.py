"""JSON content with one value at a time replaced by one of another kind, or left out."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

ODD: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1.5, 2**31, 2**63, 10**400, 1e308, -1e308, 1e-320),
    *(float("nan"), float("inf"), "", "x", "\0", "\ud800", "../x", "9" * 5000),
    *([], [[]], [None], [1, 2, 3], [[1, 2, 3]], {}, {"a": []}, [{}], [{"id": []}]),
)


def places(value: Any, here: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the keys that lead to each value in a JSON content."""
    pairs = enumerate(value) if isinstance(value, list) else ()
    for key, part in value.items() if isinstance(value, dict) else pairs:
        yield (*here, key)
        yield from places(part, (*here, key))


def faults(content: Any) -> Iterator[tuple[str, Any]]:
    """Yield (what was changed, changed content), with each of `ODD` in each place, or nothing."""
    for place in places(content):
        for odd in ODD:
            yield f"{place}: {odd!r:.40}", _changed(content, place, odd)
        yield f"{place}: removed", _changed(content, place)


def _changed(content: Any, place: tuple[Any, ...], *value: Any) -> Any:
    changed = copy.deepcopy(content)
    parent = changed
    for key in place[:-1]:
        parent = parent[key]
    if value:
        parent[place[-1]] = copy.deepcopy(value[0])
    else:
        del parent[place[-1]]
    return changed
