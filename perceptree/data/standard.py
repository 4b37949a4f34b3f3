"""Bring entries as other programs write them into COCO's form: ids, sizes, polygons, boxes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from perceptree.data.entries import Entry, EntryError, are_numbers, rows
from perceptree.data.ids import Ids, key_of
from perceptree.errors import DatasetError

Report = Callable[[EntryError], None]

_PLACES = "ids of {} are no whole numbers: they are counted in the order of the file, from {}"
_SMALLEST_POLYGON = 6  # numbers


class Standard:
    """The entries of a file in COCO's form.

    Attributes:
        images: The images that have an id.
        categories: The categories that have an id.
        annotations: The annotations whose image and category are in the file.
        notes: Messages for the user about ids.
    """

    def __init__(self, content: dict[str, Any], report: Report) -> None:
        """Change the entries of a file in place.

        Args:
            content: The file's content.
            report: Called with each entry that cannot be read; it is left out.

        Raises:
            DatasetError: If the file has no such lists, or two images have the same id.
        """
        self._report = report
        self.images, annotations = (rows(content, name) for name in ("images", "annotations"))
        if not self.images:
            raise DatasetError("holds no images, expected at least one")
        categories = rows(content, "categories") if content.get("categories") else []
        self.images = list(self._with_id(self.images, "image"))
        self.categories = named = list(self._with_id(categories, "category"))
        image_ids, category_ids = Ids(self.images, "images"), Ids(named, "categories")
        for entries, ids in ((self.images, image_ids), (named, category_ids)):
            for entry in entries:
                entry["id"] = ids.find(entry["id"])
        content["categories"] = named
        self.annotations = [
            one
            for one in annotations
            if self._points_to(one, "image_id", image_ids, "one of the images' ids")
            and (
                one.get("category_id") is None
                or not named
                or self._points_to(one, "category_id", category_ids, "the id of a category")
            )
        ]
        self.notes = [_PLACES.format("images", 0)] if image_ids.are_places else []
        if self._number(self.annotations):
            self.notes.append(_PLACES.format("annotations", 1))
        for annotation in self.annotations:
            _shape(annotation)

    def _with_id(self, entries: list[Entry], kind: str) -> Iterator[Entry]:
        for entry in entries:
            if key_of(entry.get("id")) is None:
                self._report(EntryError(entry, kind, "id", "a whole number or a text"))
            else:
                yield entry

    def _points_to(self, annotation: Entry, field: str, ids: Ids, expected: str) -> bool:
        found = ids.find(annotation.get(field))
        if found is None:
            self._report(EntryError(annotation, "annotation", field, expected))
            return False
        annotation[field] = found
        return True

    @staticmethod
    def _number(annotations: list[Entry]) -> bool:
        """Give annotations without a whole number as id their place; return whether any had none.

        Their ids only name them in messages.
        """
        odd = False
        for place, annotation in enumerate(annotations, start=1):
            key = key_of(annotation.get("id"))
            annotation["id"] = key if isinstance(key, int) else place
            odd = odd or not isinstance(key, int)
        return odd


def _shape(annotation: Entry) -> None:
    """Bring polygons, keypoints and a missing box into COCO's form, as far as they are clear."""
    polygons = annotation.get("segmentation")
    if isinstance(polygons, list) and polygons:
        annotation["segmentation"] = polygons = _polygons(polygons)
    points = annotation.get("keypoints")
    if isinstance(points, list) and points and all(_is_row(one, 3) for one in points):
        annotation["keypoints"] = [number for point in points for number in point]
    if not annotation.get("bbox") and isinstance(polygons, list):
        numbers = [polygon for polygon in polygons if are_numbers(polygon) and len(polygon) > 1]
        if numbers:
            annotation["bbox"] = box_around(numbers)


def _polygons(polygons: list[Any]) -> list[Any]:
    """A list of numbers, or of points x, y, is one polygon."""
    if are_numbers(polygons):
        return [polygons]
    if len(polygons) > 2 and all(_is_row(point, 2) for point in polygons):
        polygons = [polygons]
    return [
        [number for point in part for number in point]
        if isinstance(part, list) and part and all(_is_row(point, 2) for point in part)
        else part
        for part in polygons
    ]


def _is_row(value: Any, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and are_numbers(value)


def box_around(polygons: Sequence[Sequence[float]]) -> list[float]:
    """Return the box x, y, width, height around polygons x, y, x, y, ...; zeros around none."""
    xs = [x for polygon in polygons for x in polygon[::2]]
    ys = [y for polygon in polygons for y in polygon[1::2]]
    return [min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys)] if xs and ys else [0, 0, 0, 0]


def drop_short_parts(annotation: Entry) -> int:
    """Remove polygons of fewer than three points or without height or width.

    Returns:
        How many were removed.
    """
    polygons = annotation.get("segmentation")
    if not isinstance(polygons, list):
        return 0
    kept = [polygon for polygon in polygons if not _is_short(polygon)]
    if len(kept) < len(polygons):
        annotation["segmentation"] = kept
    return len(polygons) - len(kept)


def _is_short(polygon: Any) -> bool:
    if not are_numbers(polygon) or len(polygon) % 2:
        return False  # broken, which is told
    if len(polygon) < _SMALLEST_POLYGON:
        return True
    xs, ys = polygon[::2], polygon[1::2]
    return bool(min(xs) == max(xs) or min(ys) == max(ys))
