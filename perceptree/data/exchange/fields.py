"""Read fields of the files of labelling tools; errors are one line that names the file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from perceptree.data.content import load
from perceptree.errors import DatasetError

LARGEST_LABELS_BYTES = 2**30


def load_json(path: Path, expected: str) -> Any:
    """Read a JSON file.

    Raises:
        DatasetError: If it cannot be read or is not JSON.
    """
    try:
        return load(path)
    except DatasetError as error:
        raise DatasetError(f"{path}: {error}".replace("a COCO file", expected)) from error


def number(value: Any, path: Path, what: str) -> float:
    """Return a finite number, also from a text.

    Raises:
        DatasetError: If it is none.
    """
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not math.isfinite(found):
        raise DatasetError(f"{path}: {what} is {str(value)[:60]!r}, expected a finite number")
    return found


def numbers(values: Any, path: Path, what: str) -> list[float]:
    """Return a list of finite numbers; see `number`."""
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise DatasetError(f"{path}: {what} is {str(values)[:60]!r}, expected a list of numbers")
    return [number(value, path, what) for value in values]


def size(width: Any, height: Any, path: Path) -> tuple[int | None, int | None]:
    """Return a stated size of a picture in px, None for each if it is missing."""
    if width is None or height is None:
        return None, None
    found = [number(value, path, "the size of a picture") for value in (width, height)]
    if not all(value.is_integer() and 1 <= value < 2**31 for value in found):
        raise DatasetError(
            f"{path}: the size of a picture is {width}x{height}, expected whole numbers over 0"
        )
    return int(found[0]), int(found[1])
