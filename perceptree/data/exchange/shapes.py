"""Collect the shapes that a labelling tool writes as the content of a COCO file."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pycocotools import mask as coco_masks

from basetree.arrays import Bool
from calib import encode_rle, image_to_opencv
from perceptree.data.entries import Entry
from perceptree.data.standard import box_around

_BORDER_PX = 1.0
_VISIBLE = 2  # COCO's flag

LARGEST_MASK_PX = 2**28
"""Pixels of the largest picture whose masks are unpacked."""


@dataclass
class _Region:
    """A labelled region: polygons, run lengths, or a box alone."""

    entry: Entry
    keys: set[Hashable]
    points: dict[str, list[float]] = field(default_factory=dict)

    def holds(self, x: float, y: float) -> bool:
        left, top, width, height = self.entry["bbox"]
        return bool(
            left - _BORDER_PX <= x <= left + width + _BORDER_PX
            and top - _BORDER_PX <= y <= top + height + _BORDER_PX
        )

    @property
    def box_area_px(self) -> float:
        return float(self.entry["bbox"][2] * self.entry["bbox"][3])


@dataclass(frozen=True)
class _Point:
    """A labelled point in continuous px."""

    label: str
    x: float
    y: float
    flag: int
    key: Hashable


class Shapes:
    """Builds the content of a COCO file from pictures, regions and points.

    Call `add_picture` for each picture, then `add_region` and `add_point` for what is drawn on it.
    A point belongs to the region with its key; without one, to the smallest region whose box holds
    it and that has no point of this name yet. Coordinates are continuous px.

    Attributes:
        lost_points: Number of points that belong to no region, known after `content`.
    """

    def __init__(self) -> None:
        self.lost_points = 0
        self._images: list[Entry] = []
        self._regions: list[list[_Region]] = []
        self._points: list[list[_Point]] = []
        self._categories: dict[str, int] = {}

    def add_picture(self, name: str, width_px: int | None, height_px: int | None) -> None:
        """Begin a picture; without a size, that of its file is taken when it is read."""
        image: Entry = {"id": len(self._images) + 1, "file_name": name}
        if width_px is not None and height_px is not None:
            image |= {"width": width_px, "height": height_px}
        self._images.append(image)
        self._regions.append([])
        self._points.append([])

    def add_region(
        self, label: str, shape: dict[str, Any], keys: Sequence[Hashable] = (), **fields: Any
    ) -> None:
        """Add a region to the picture.

        Args:
            label: Name of its category.
            shape: Its fields `bbox` and `segmentation` as in COCO; a missing box is that of the
                polygons.
            keys: What names the region, for points and for further polygons or run lengths of the
                same one.
            fields: Further fields of the annotation.
        """
        for region in self._regions[-1]:
            parts = shape.get("segmentation"), region.entry.get("segmentation")
            if region.keys & set(keys) and all(isinstance(part, list) and part for part in parts):
                region.entry["segmentation"] += shape["segmentation"]
                region.entry["bbox"] = box_around(region.entry["segmentation"])
                return
            if region.keys & set(keys) and all(isinstance(part, dict) for part in parts):
                region.entry |= _joined(parts)
                return
        category = self._categories.setdefault(label, len(self._categories) + 1)
        entry: Entry = {"image_id": len(self._images), "category_id": category, **shape, **fields}
        if "bbox" not in entry:
            entry["bbox"] = box_around(entry["segmentation"])
        self._regions[-1].append(_Region(entry, set(keys)))

    def add_point(
        self, label: str, x: float, y: float, flag: int = _VISIBLE, key: Hashable = None
    ) -> None:
        """Add a point to the picture.

        Args:
            label: Name of the keypoint.
            x: Across, continuous px.
            y: Down, continuous px.
            flag: COCO's visibility flag.
            key: One of the keys of its region; None if the point names none.
        """
        self._points[-1].append(_Point(label, x, y, flag, key))

    def content(self) -> dict[str, Any]:
        """Return the content of a COCO file."""
        names = list(dict.fromkeys(point.label for points in self._points for point in points))
        annotations: list[Entry] = []
        for regions, points in zip(self._regions, self._points, strict=True):
            self._give_points(regions, points)
            for region in regions:
                if names:
                    region.entry["keypoints"] = _listed(region.points, names)
                annotations.append({"id": len(annotations) + 1, **region.entry})
        keypoints = {"keypoints": names} if names else {}
        categories = [
            {"id": number, "name": name, **keypoints} for name, number in self._categories.items()
        ]
        return {"images": self._images, "annotations": annotations, "categories": categories}

    def _give_points(self, regions: list[_Region], points: list[_Point]) -> None:
        by_size = sorted(regions, key=lambda region: region.box_area_px)
        for point in points:
            named = [one for one in regions if point.key is not None and point.key in one.keys]
            around = [one for one in by_size if one.holds(point.x, point.y)]
            free = [one for one in named or around if point.label not in one.points]
            if free:
                at = image_to_opencv(np.array([point.x, point.y])).tolist()
                free[0].points[point.label] = [*at, point.flag]
            else:
                self.lost_points += 1


def _listed(points: dict[str, list[float]], names: list[str]) -> list[float]:
    return [value for name in names for value in points.get(name, [0, 0, 0])]


def mask_entry(mask: Bool) -> dict[str, Any]:
    """The run lengths and the box of a mask (H, W); of an empty one a box of zeros alone."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not rows.size:
        return {"bbox": [0, 0, 0, 0]}
    left, top = int(columns[0]), int(rows[0])
    box = [left, top, int(columns[-1]) + 1 - left, int(rows[-1]) + 1 - top]
    return {"segmentation": encode_rle(mask), "bbox": box}


def _joined(runs: Iterable[Any]) -> Entry:
    """The fields of a region of several run lengths."""
    whole = coco_masks.merge([{**each, "counts": each["counts"].encode()} for each in runs])
    segmentation = {**whole, "counts": whole["counts"].decode()}
    return {"segmentation": segmentation, "bbox": coco_masks.toBbox(whole).tolist()}
