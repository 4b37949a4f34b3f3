"""Convert the content of a COCO file to records of frames and trees."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from basetree.arrays import Float64
from basetree.files.limits import current_limits
from calib import opencv_to_image
from perceptree.data.coco import FrameRecord, TreeRecord
from perceptree.data.entries import (
    Entry,
    EntryError,
    check_segmentation,
    flag,
    named_numbers,
    numbers,
    refuse,
    rows,
    whole,
)
from perceptree.data.names import KeypointMap, NameMap, map_names
from perceptree.data.pictures import Pictures
from perceptree.errors import DatasetError
from perceptree.keypoints import KEYPOINT_NAMES

OnError = Callable[[EntryError], None]

_TRUTH_FIELDS = ("distance_m", "diameter_m", "cut_height_m", "inclination_deg", "visible_fraction")
_FRAME_FIELDS = ("camera", "up_camera", "depth_encoding", "scene")
_FILE_FIELDS = ("file_name", "depth_file", "depth8_file")
_BORDER_PX = 1.0
_CHUNK = 512
_FLAGS = frozenset((0, 1, 2))
_IN_ORDER = tuple(range(len(KEYPOINT_NAMES)))
_NOTHING = [0.0] * (3 * len(KEYPOINT_NAMES))


@dataclass(frozen=True, eq=False)
class Parsed:
    """The parsed content of a file.

    Attributes:
        frames: The frames.
        notes: Messages for the user.
        has_masks: Whether every tree has a mask.
        outside: (annotation id, x, y) of keypoints outside their frame.
    """

    frames: list[FrameRecord]
    notes: tuple[str, ...]
    has_masks: bool
    outside: list[tuple[int, float, float]]


class _TreeEntry(NamedTuple):
    """A checked annotation, as on disk, with the size of its image."""

    entry: Entry
    box: list[float]
    points: list[float]
    size: tuple[int, int]
    truth: dict[str, float]
    crowd: bool
    marked: bool


class Parser:
    """Reads the entries of one file.

    Without `on_error` the first invalid entry is raised. With it, each invalid entry is passed to
    it and left out.
    """

    def __init__(self, pictures: Pictures, on_error: OnError | None = None) -> None:
        self._pictures = pictures
        self._on_error = on_error
        self._names = NameMap(frozenset(), {}, ())
        self._with_masks = True
        self._last_extra: dict[str, Any] = {}
        self.outside: list[tuple[int, float, float]] = []

    def parse(self, content: dict[str, Any]) -> Parsed:
        """Convert a file's content to frames.

        Empties `content` as it goes, to save memory.

        Raises:
            DatasetError: If the content is not COCO or, without `on_error`, an entry is invalid.
        """
        images, annotations = (rows(content, name) for name in ("images", "annotations"))
        if not images:
            raise DatasetError("holds no images, expected at least one")
        self._names = map_names(content, annotations)
        self._with_masks = self._decide_masks(annotations)
        trees = self._by_image(images, annotations)
        content.clear()
        annotations.clear()
        frames: list[FrameRecord] = []
        for first in range(0, len(images), _CHUNK):
            chunk = images[first : first + _CHUNK]
            frames += self._frames(chunk, [trees.pop(image["id"]) for image in chunk])
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
                f"{len(self.outside)} keypoints are outside their frame and count as not labelled,"
                f" the first at {_example(self.outside)}"
            )
        if not self._with_masks:
            notes.append("the set has no masks")
        return tuple(notes)

    def _decide_masks(self, annotations: list[Entry]) -> bool:
        """Return whether any tree has a mask; then all trees must have one."""
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
            raise DatasetError(f"{times} images have the id {shared}, expected unique ids")
        for annotation in annotations:
            try:
                owner = whole(annotation, "annotation", "image_id")
                if owner not in trees:
                    refuse(annotation, "annotation", "image_id", "one of the images' ids")
                trees[owner].append(annotation)
            except EntryError as error:
                self._report(error)
        return trees

    def _frames(self, images: list[Entry], trees: list[list[Entry]]) -> list[FrameRecord]:
        """Create the records of some images; boxes and keypoints are rows of two shared arrays."""
        found: list[_TreeEntry] = []
        usable: list[Entry] = []
        ends: list[int] = []
        for image, labels in zip(images, trees, strict=True):
            try:
                _check_image(image, self._pictures)
            except EntryError as error:
                self._report(error)
                continue
            for annotation in labels:
                try:
                    self._check_tree(annotation, image, found)
                except EntryError as error:
                    self._report(error)
            usable.append(image)
            ends.append(len(found))
        records = self._records(found)
        return [
            self._frame(image, tuple(records[first:end]))
            for image, first, end in zip(usable, [0, *ends], ends, strict=False)
        ]

    def _frame(self, image: Entry, trees: tuple[TreeRecord, ...]) -> FrameRecord:
        extra = {name: image[name] for name in _FRAME_FIELDS if name in image}
        for name, value in self._last_extra.items():
            if extra.get(name) == value:  # frames share equal objects, such as one camera
                extra[name] = value
        self._last_extra = extra
        paths = self._pictures.of(image)
        return FrameRecord(image["id"], *paths, image["width"], image["height"], extra, trees)

    def _check_tree(self, annotation: Entry, image: Entry, found: list[_TreeEntry]) -> None:
        """Add an annotation to `found` if it is a tree.

        Raises:
            EntryError: If it is invalid.
        """
        keypoints = self._names.of(annotation)
        if keypoints is None:
            return
        box, points = _box(annotation), _points(annotation, keypoints)
        crowd, marked = flag(annotation, "iscrowd"), flag(annotation, "ignore")
        if annotation.get("segmentation"):
            check_segmentation(annotation, image["width"], image["height"])
        elif self._with_masks and not (crowd or marked):
            expected = "polygons or run lengths, because other trees in the file have them"
            refuse(annotation, "annotation", "segmentation", expected)
        truth, size = named_numbers(annotation, _TRUTH_FIELDS), (image["width"], image["height"])
        found.append(_TreeEntry(annotation, box, points, size, truth, crowd, marked))

    def _records(self, found: list[_TreeEntry]) -> list[TreeRecord]:
        boxes = np.array([one.box for one in found], float).reshape(-1, 4)
        boxes[:, 2:] += boxes[:, :2]
        return [
            TreeRecord(
                one.entry["id"],
                box,
                points,
                one.entry.get("segmentation") or None,
                one.crowd,
                one.truth,
                _species(one.entry),
                one.marked,
            )
            for one, box, points in zip(found, boxes, self._keypoints_in_frame(found), strict=True)
        ]

    def _keypoints_in_frame(self, found: list[_TreeEntry]) -> Float64:
        """Convert keypoints from pixel indices to continuous px inside their frames.

        Keypoints up to 1 px outside, such as rounded coordinates, are moved to the border.
        Keypoints farther outside are treated as not labelled, as in PercepTreeV1's training.

        Returns:
            (N, 5, 3) x, y, flag.
        """
        listed = [one.points for one in found]
        keypoints = np.array(listed, np.float64).reshape(-1, len(KEYPOINT_NAMES), 3)
        sizes = np.array([one.size for one in found], np.float64).reshape(-1, 1, 2)
        labelled = keypoints[..., 2] > 0
        keypoints[..., :2] = opencv_to_image(keypoints[..., :2])
        gap = np.maximum(-keypoints[..., :2], keypoints[..., :2] - sizes).max(-1)
        outside = labelled & (gap > _BORDER_PX)
        for row, point in zip(*np.nonzero(outside), strict=True):
            x, y = listed[row][3 * point : 3 * point + 2]
            self.outside.append((found[row].entry["id"], x, y))
        keypoints[~labelled | outside] = 0.0
        keypoints[..., :2] = np.clip(keypoints[..., :2], 0.0, sizes)
        return keypoints


def _check_image(image: Entry, pictures: Pictures) -> None:
    for key in _FILE_FIELDS:
        name = image.get(key)
        if name is None and key != "file_name":
            continue
        if not isinstance(name, str) or not name or "\0" in name or not pictures.is_inside(name):
            refuse(image, "image", key, "the path of a file in the dataset's folder")
    largest = current_limits().image_pixels
    for key in ("width", "height"):
        if whole(image, "image", key) < 1:
            refuse(image, "image", key, "at least 1 px")
    if image["width"] * image["height"] > largest:
        refuse(image, "image", "width", f"a picture of at most {largest} pixels")


def _example(outside: list[tuple[int, float, float]]) -> str:
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
    """Return the five keypoints as on disk, [x, y, flag, ...]; zeros for missing ones."""
    if not annotation.get("keypoints"):
        return _NOTHING
    listed = numbers(annotation, "keypoints", 3 * keypoints.count)
    if not _FLAGS.issuperset(listed[2::3]):
        refuse(annotation, "annotation", "keypoints", "flags of 0, 1 or 2")
    if keypoints.indices is None:
        return _NOTHING
    if keypoints.indices == _IN_ORDER and len(listed) == len(_NOTHING):
        return listed
    values: list[float] = []
    for index in keypoints.indices:
        values += [0.0] * 3 if index < 0 else listed[3 * index : 3 * index + 3]
    return values
