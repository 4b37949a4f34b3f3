"""Tables of parameters: JSON files beside the code that draws with them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from typing import Any


def read_rows(file: str, words: Mapping[str, Any] | None = None) -> dict[str, dict[str, Any]]:
    """Read a table of this package.

    Args:
        file: Its path from this package's folder, such as "materials/barks.json": an object of
            rows by name, each an object of values by the fields of a dataclass.
        words: What words in the rows stand for.

    Returns:
        The rows by name; lists are tuples.
    """

    def value(found: Any) -> Any:
        if isinstance(found, list):
            return tuple(map(value, found))
        return words[found] if words is not None and isinstance(found, str) else found

    text = resources.files("perceptree.simulator").joinpath(file).read_text("utf-8")
    return {
        name: {field: value(found) for field, found in row.items()}
        for name, row in json.loads(text).items()
    }
