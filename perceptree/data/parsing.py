"""A COCO file's content becomes records of frames and trees."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import opencv_to_image
from perceptree.data.coco import KEYPOINTS, Float, FrameRecord, TreeRecord
from perceptree.data.entries import (
    Entry,
    EntryError,
    check_segmentation,
    number,
    numbers,
    refuse,
    rows,
    whole,
)
from perceptree.data.names import KeypointMap, NameMap, map_names
from perceptree.data.pictures import Pictures
from perceptree.errors import DatasetError

OnError = Callable[[EntryError], None]

_TRUTH_FIELDS = ("distance_m", "diameter_m", "cut_height_m", "inclination_deg", "visible_fraction")
_FRAME_FIELDS = ("camera", "up_camera", "depth_encoding", "scene")
_FILE_FIELDS = ("file_name", "depth_file", "depth8_file")
_BORDER_PX = 1.0


@dataclass(frozen=True, eq=False)
class Parsed:
    """A file's frames, what to say of them, and (number, x, y) of keypoints outside the frame."""

    frames: list[FrameRecord]
    notes: tuple[str, ...]
    has_masks: bool
    outside: list[tuple[int, float, float]]


class Parser:
    """Reads the entries of one file.

    Without ``on_error`` the first wrong entry is raised; with it, each is handed over and left out.
    """

    def __init__(self, pictures: Pictures, on_error: OnError | None = None) -> None:
        self._pictures = pictures
        self._on_error = on_error
        self._names = NameMap(frozenset(), {}, ())
        self._with_masks = True
        self._last_extra: dict[str, Any] = {}
        self.outside: list[tuple[int, float, float]] = []

    def parse(self, content: dict[str, Any]) -> Parsed:
        """The frames of a file; empties ``content``, so that both are never held whole.

        Raises DatasetError.
        """
        images, annotations = (rows(content, name) for name in ("images", "annotations"))
        if not images:
            raise DatasetError("holds no images, expected at least one")
        self._names = map_names(content, annotations)
        self._with_masks = self._decide_masks(annotations)
        trees = self._by_image(images, annotations)
        content.clear()
        annotations.clear()
        frames = []
        for image in images:
            try:
                frames.append(self._frame(image, trees.pop(image["id"])))
            except EntryError as error:
                self._report(error)
        if not frames:
            raise DatasetError("holds no usable images, expected at least one")
        return Parsed(frames, self._notes(), self._with_masks, self.outside)

    def _report(self, error: EntryError) -> None:
        if self._on_error is None:
            raise error
        self._on_error(error)

    def _notes(self) -> tuple[str, ...]:
        notes = [*self._names.notes]
        if self.outside:
            notes.append(
                f"{len(self.outside)} keypoints lie outside their frame and count as not labelled,"
                f" first {_listed(self.outside)}"
            )
        if not self._with_masks:
            notes.append("the set has no masks")
        return tuple(notes)

    def _decide_masks(self, annotations: list[Entry]) -> bool:
        """Whether the set has masks: as soon as one tree has."""
        known, trees = self._names.known, self._names.keypoints
        return not annotations or any(
            annotation.get("segmentation")
            for annotation in annotations
            if not known or annotation.get("category_id") in trees
        )

    def _by_image(self, images: list[Entry], annotations: list[Entry]) -> dict[int, list[Entry]]:
        trees: dict[int, list[Entry]] = {}
        for image in images:
            trees[whole(image, "image", "id")] = []
        if len(trees) < len(images):
            shared, times = Counter(image["id"] for image in images).most_common(1)[0]
            raise DatasetError(f"{times} images share an id, {shared}, expected each once")
        for annotation in annotations:
            try:
                owner = whole(annotation, "annotation", "image_id")
                if owner not in trees:
                    refuse(annotation, "annotation", "image_id", "one of the images' ids")
                trees[owner].append(annotation)
            except EntryError as error:
                self._report(error)
        return trees

    def _frame(self, image: Entry, annotations: list[Entry]) -> FrameRecord:
        for field in _FILE_FIELDS:
            name = image.get(field)
            if not (isinstance(name, str) and name) and (field == "file_name" or name is not None):
                refuse(image, "image", field, "the path of a file within the dataset")
        width, height = (whole(image, "image", field) for field in ("width", "height"))
        for field, size in (("width", width), ("height", height)):
            if size < 1:
                refuse(image, "image", field, "at least 1 px")
        colour, depth, depth8 = self._pictures.of(image)
        return FrameRecord(
            image["id"], colour, depth, depth8, width, height, self._extra(image),
            self._trees(annotations, width, height),
        )  # fmt: skip

    def _extra(self, image: Entry) -> dict[str, Any]:
        """What else is known of a frame; parts equal to the last frame's are the same objects."""
        extra = {name: image[name] for name in _FRAME_FIELDS if name in image}
        for name, value in self._last_extra.items():
            if name in extra and extra[name] == value:
                extra[name] = value
        self._last_extra = extra
        return extra

    def _trees(self, annotations: list[Entry], width: int, height: int) -> tuple[TreeRecord, ...]:
        """The records of a frame's trees; their boxes and keypoints are rows of two arrays."""
        kept: list[Entry] = []
        boxes: list[list[float]] = []
        points: list[list[float]] = []
        truths: list[dict[str, float]] = []
        for annotation in annotations:
            try:
                keypoints = self._names.of(annotation)
                if keypoints is None:
                    continue
                found = _box(annotation), _points(annotation, keypoints)
                self._check_mask(annotation, width, height)
                truth = {n: number(annotation, n) for n in _TRUTH_FIELDS if n in annotation}
            except EntryError as error:
                self._report(error)
                continue
            kept.append(annotation)
            boxes.append(found[0])
            points.append(found[1])
            truths.append(truth)
        if not kept:
            return ()
        box_px = np.array(boxes, float)
        box_px[:, 2:] += box_px[:, :2]
        placed = self._place(np.array(points, float).reshape(-1, KEYPOINTS, 3), kept, width, height)
        return tuple(
            TreeRecord(
                annotation["id"], box, rows_, annotation["segmentation"] if self._with_masks and
                annotation.get("segmentation") else None, bool(annotation.get("iscrowd", 0)),
                truth, _species(annotation),
            )
            for annotation, box, rows_, truth in zip(kept, box_px, placed, truths, strict=True)
        )  # fmt: skip

    def _check_mask(self, annotation: Entry, width: int, height: int) -> None:
        """A mask for every tree, or for none; a crowd may do without."""
        if annotation.get("segmentation"):
            check_segmentation(annotation, width, height)
        elif self._with_masks and not annotation.get("iscrowd", 0):
            expected = "polygons or runs, as other trees of the file have"
            refuse(annotation, "annotation", "segmentation", expected)

    def _place(
        self, points: Float, annotations: list[Entry], width: int, height: int
    ) -> NDArray[np.float64]:
        """Keypoints (N, 5, 3) from pixel indices on disk to corner-based px, within the frame.

        What lies at most 1 px outside is put on the border (a rounded coordinate); what lies
        farther out is not labelled, as PercepTreeV1's own training has it.
        """
        places = np.asarray(points, np.float64)
        labelled = places[..., 2] > 0
        places[..., :2] = opencv_to_image(places[..., :2])
        size = np.array([width, height], float)
        gap = np.maximum(-places[..., :2], places[..., :2] - size).max(-1)
        outside = labelled & (gap > _BORDER_PX)
        for row, place in zip(*np.nonzero(outside), strict=True):
            x, y = places[row, place, :2].tolist()
            self.outside.append((annotations[row]["id"], x - 0.5, y - 0.5))
        places[~labelled | outside] = 0.0
        places[..., :2] = np.clip(places[..., :2], 0.0, size)
        return places


def _listed(outside: list[tuple[int, float, float]]) -> str:
    tree, x, y = outside[0]
    return f"x = {x:.6g}, y = {y:.6g} of annotation {tree}"


def _species(annotation: Entry) -> str | None:
    species = annotation.get("species")
    return species if isinstance(species, str) else None


def _box(annotation: Entry) -> list[float]:
    whole(annotation, "annotation", "id")
    box = numbers(annotation, "bbox", 4)
    if box[2] <= 0 or box[3] <= 0:
        refuse(annotation, "annotation", "bbox", "a width and height over 0")
    return box


def _points(annotation: Entry, keypoints: KeypointMap) -> list[float]:
    """Our five keypoints as x, y, flag, ..., as they are on disk; zeros for what there is not."""
    if not annotation.get("keypoints"):
        return [0.0] * (3 * KEYPOINTS)
    listed = numbers(annotation, "keypoints", 3 * keypoints.count)
    if not {0, 1, 2}.issuperset(listed[2::3]):
        refuse(annotation, "annotation", "keypoints", "flags of 0, 1 or 2")
    if keypoints.places is None:
        return [0.0] * (3 * KEYPOINTS)
    values: list[float] = []
    for place in keypoints.places:
        values += [0.0] * 3 if place < 0 else listed[3 * place : 3 * place + 3]
    return values
