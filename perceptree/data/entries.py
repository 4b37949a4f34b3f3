"""Entries of a COCO file: fields read and checked, each refusal one line that names the entry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NoReturn

from perceptree.errors import DatasetError

Entry = dict[str, Any]

_NUMBERS = frozenset((int, float))
_SHOWN = 60


class EntryError(DatasetError):
    """One entry of a file is wrong: ``kind`` (image or annotation), ``number`` (its id), field."""

    def __init__(self, entry: Entry, kind: str, field: str, expected: str) -> None:
        self.kind, self.field, self.number = kind, field, entry.get("id", "?")
        value = repr(entry[field]) if field in entry else "missing"
        shown = value if len(value) <= _SHOWN else value[: _SHOWN - 3] + "..."
        super().__init__(f"{field} of {kind} {self.number} is {shown}, expected {expected}")


def refuse(entry: Entry, kind: str, field: str, expected: str) -> NoReturn:
    """Say which entry of the file has which field wrong."""
    raise EntryError(entry, kind, field, expected)


def rows(content: Any, name: str) -> list[Entry]:
    """The file's list of that name, each an object. Raises DatasetError for anything else."""
    if not isinstance(content, dict):
        raise DatasetError("expected a COCO file with images and annotations")
    found = content.get(name)
    if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
        raise DatasetError(f"expected a COCO file with a list of {name}")
    return found


def whole(entry: Entry, kind: str, field: str) -> int:
    """A field's whole number."""
    value = entry.get(field)
    if isinstance(value, bool) or not isinstance(value, int):
        refuse(entry, kind, field, "a whole number")
    return value


def numbers(annotation: Entry, field: str, count: int) -> list[float]:
    """A field's list of ``count`` finite numbers."""
    values = annotation.get(field)
    if not isinstance(values, list) or len(values) != count or not are_numbers(values):
        refuse(annotation, "annotation", field, f"{count} finite numbers")
    return values


def named_numbers(annotation: Entry, fields: Sequence[str]) -> dict[str, float]:
    """Those of the fields that the annotation has, each a finite number."""
    values = {name: annotation[name] for name in fields if name in annotation}
    if not are_numbers(list(values.values())):
        wrong = next(name for name, value in values.items() if not are_numbers([value]))
        refuse(annotation, "annotation", wrong, "1 finite number")
    return values


def are_numbers(values: Any) -> bool:
    """Whether this is a list of finite numbers and nothing else; true and false are none."""
    if not isinstance(values, list) or not _NUMBERS.issuperset(map(type, values)):
        return False
    try:
        return math.isfinite(math.fsum(values))
    except (OverflowError, ValueError):  # infinities of both signs, or numbers beyond a float
        return False


def check_segmentation(annotation: Entry, width: int, height: int) -> None:
    """Raise EntryError unless it is polygons, or runs of the frame's size."""
    segmentation = annotation["segmentation"]
    if isinstance(segmentation, dict):
        runs, size = segmentation.get("counts"), segmentation.get("size")
        fits = isinstance(runs, str | list) and size == [height, width]
    else:
        fits = isinstance(segmentation, list) and all(
            are_numbers(polygon) and len(polygon) >= 6 and len(polygon) % 2 == 0
            for polygon in segmentation
        )
    if not fits:
        expected = f"polygons x, y, ... or runs of size [{height}, {width}]"
        refuse(annotation, "annotation", "segmentation", expected)
