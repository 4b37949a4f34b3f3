"""Read and check fields of COCO entries; errors are one line that names the entry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np

from perceptree.errors import DatasetError

Entry = dict[str, Any]

_NUMBERS = frozenset((int, float))
_SHOWN = 60


class EntryError(DatasetError):
    """An invalid entry of a label file.

    Attributes:
        kind: "image" or "annotation".
        number: The entry's id.
        field: The invalid field.
    """

    def __init__(self, entry: Entry, kind: str, field: str, expected: str) -> None:
        self.kind, self.field, self.number = kind, field, entry.get("id", "?")
        value = repr(entry[field]) if field in entry else "missing"
        shown = value if len(value) <= _SHOWN else value[: _SHOWN - 3] + "..."
        super().__init__(f"{field} of {kind} {self.number} is {shown}, expected {expected}")


def refuse(entry: Entry, kind: str, field: str, expected: str) -> NoReturn:
    """Raise an EntryError for a field of an entry."""
    raise EntryError(entry, kind, field, expected)


def rows(content: Any, name: str) -> list[Entry]:
    """Return the file's list of that name.

    Raises:
        DatasetError: If it is missing or not a list of objects.
    """
    if not isinstance(content, dict):
        raise DatasetError("expected a COCO file with images and annotations")
    found = content.get(name)
    if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
        raise DatasetError(f"expected a COCO file with a list of {name}")
    return found


def whole(entry: Entry, kind: str, field: str) -> int:
    """Return a field's integer; raises EntryError for anything else."""
    value = entry.get(field)
    if isinstance(value, bool) or not isinstance(value, int):
        refuse(entry, kind, field, "a whole number")
    return value


def flag(annotation: Entry, field: str) -> bool:
    """Return a field of 0 or 1, 0 if it is missing; raises EntryError for anything else."""
    value = annotation.get(field, 0)
    if type(value) not in (int, bool) or value not in (0, 1):
        refuse(annotation, "annotation", field, "0 or 1")
    return bool(value)


def numbers(annotation: Entry, field: str, count: int) -> list[float]:
    """Return a field's list of `count` finite numbers; raises EntryError for anything else."""
    values = annotation.get(field)
    if not isinstance(values, list) or len(values) != count or not are_numbers(values):
        refuse(annotation, "annotation", field, f"{count} finite numbers")
    return values


def named_numbers(annotation: Entry, fields: Sequence[str]) -> dict[str, float]:
    """Return the fields that are present; raises EntryError unless all are finite numbers."""
    values = {name: annotation[name] for name in fields if name in annotation}
    if not are_numbers(list(values.values())):
        wrong = next(name for name, value in values.items() if not are_numbers([value]))
        refuse(annotation, "annotation", wrong, "1 finite number")
    return values


def are_numbers(values: Any) -> bool:
    """Return whether `values` is a list of finite numbers; bools do not count."""
    if not isinstance(values, list) or not _NUMBERS.issuperset(map(type, values)):
        return False
    try:
        return math.isfinite(math.fsum(values))
    except (OverflowError, ValueError):  # both infinities, or too large for a float
        return False


def check_segmentation(annotation: Entry, width: int, height: int) -> None:
    """Raise EntryError unless the segmentation is polygons, or run lengths of the frame's size."""
    segmentation = annotation["segmentation"]
    if isinstance(segmentation, dict):
        runs, size = segmentation.get("counts"), segmentation.get("size")
        fits = isinstance(runs, str | list) and size == [height, width]
    else:
        fits = isinstance(segmentation, list) and all(
            are_numbers(polygon) and len(polygon) >= 6 and len(polygon) % 2 == 0
            for polygon in segmentation
        )
        longest_px = width * height + 4 * (width + height)
        if fits and sum(map(_boundary_px, segmentation)) > longest_px:
            expected = f"polygons whose boundaries have at most {longest_px} px in sum"
            refuse(annotation, "annotation", "segmentation", expected)
    if not fits:
        expected = f"polygons x, y, ... or runs of size [{height}, {width}]"
        refuse(annotation, "annotation", "segmentation", expected)


def _boundary_px(polygon: list[float]) -> float:
    """Pixels on a polygon's boundary and on the way to it from the frame's corner.

    The decoder takes memory for each of them, and does not survive numbers beyond 32 bits.
    """
    points = np.array([0.0, 0.0, *polygon], np.float64).reshape(-1, 2)
    with np.errstate(over="ignore"):
        return float(np.abs(np.diff(points, axis=0)).max(1).sum())
