"""Convert the content of a COCO file to records of frames and trees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from basetree.arrays import Float64
from calib import opencv_to_image
from perceptree.data.coco import FrameRecord, TreeRecord
from perceptree.data.entries import (
    Entry,
    EntryError,
    check_segmentation,
    flag,
    named_numbers,
    refuse,
)
from perceptree.data.fields import check_image, has_area, keypoints_of
from perceptree.data.joining import join_keypoints
from perceptree.data.names import NameMap, map_names
from perceptree.data.pictures import Pictures
from perceptree.data.standard import Standard, drop_short_parts
from perceptree.data.tally import Tally
from perceptree.errors import DatasetError
from perceptree.keypoints import KEYPOINT_NAMES

OnError = Callable[[EntryError], None]

_TRUTH_FIELDS = ("distance_m", "diameter_m", "cut_height_m", "inclination_deg", "visible_fraction")
_FRAME_FIELDS = (
    *("camera", "up_camera", "depth_encoding", "scene"),
    *("depth_sensor", "pose", "realism", "time_s", "pose_world"),
)
# Of simulated trees; no part of this package uses them, but copies of a dataset keep them.
_TREE_FIELDS = (
    *("diameter_height_m", "diameter_breast_m", "position_m", "position_world_m"),
    *("model", "stem"),
)
_BORDER_PX = 1.0
_CHUNK = 512


@dataclass(frozen=True, eq=False)
class Parsed:
    """The parsed content of a file.

    Attributes:
        frames: The frames.
        notes: Messages for the user.
        has_masks: Whether every tree has a mask.
        tally: What was left out.
    """

    frames: list[FrameRecord]
    notes: tuple[str, ...]
    has_masks: bool
    tally: Tally


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
    it and left out. Annotations without an area or content are always left out and counted.
    """

    def __init__(
        self, pictures: Pictures, on_error: OnError | None = None, crowds_as_trees: bool = False
    ) -> None:
        self._pictures = pictures
        self._on_error = on_error
        self._crowds_as_trees = crowds_as_trees
        self._first_error: EntryError | None = None
        self._names = NameMap(frozenset(), {}, ())
        self._with_masks = True
        self._last_extra: dict[str, Any] = {}
        self._without_parts: set[int] = set()
        self._tally = Tally()

    def parse(self, content: dict[str, Any], keypoints: Path | None = None) -> Parsed:
        """Convert a file's content to frames.

        Empties `content` as it goes, to save memory.

        Args:
            content: The file's content.
            keypoints: A second file with the keypoints.

        Raises:
            DatasetError: If the content is not COCO or, without `on_error`, an entry is invalid.
        """
        entries = Standard(content, self._report)
        images, annotations = entries.images, entries.annotations
        if not images:
            raise DatasetError(
                f"holds no usable images ({self._first_error}), expected at least one"
            )
        joined = (
            [join_keypoints(entries, keypoints, self._report, self._tally)] if keypoints else []
        )
        self._names = map_names(content, annotations)
        self._with_masks = self._decide_masks(annotations)
        trees: dict[int, list[Entry]] = {image["id"]: [] for image in images}
        for annotation in annotations:
            trees[annotation["image_id"]].append(annotation)
        content.clear()
        annotations.clear()
        frames: list[FrameRecord] = []
        for first in range(0, len(images), _CHUNK):
            chunk = images[first : first + _CHUNK]
            frames += self._frames(chunk, [trees.pop(image["id"]) for image in chunk])
        if not frames:
            first_of_all = f" ({self._first_error})" if self._first_error else ""
            raise DatasetError(f"holds no usable images{first_of_all}, expected at least one")
        self._tally.shared = len(frames) - len({frame.image_path for frame in frames})
        notes = [*joined, *entries.notes, *self._names.notes, *self._tally.notes()]
        if not self._with_masks:
            notes.append("the set has no masks")
        return Parsed(frames, tuple(notes), self._with_masks, self._tally)

    def _report(self, error: EntryError) -> None:
        if self._on_error is None:
            raise error
        self._first_error = self._first_error or error
        self._on_error(error)

    def _decide_masks(self, annotations: list[Entry]) -> bool:
        """Return whether any tree has a mask; then all trees must have one.

        Removes polygons of fewer than three points.
        """
        known, trees = self._names.known, self._names.keypoints
        masks = False
        for annotation in annotations:
            category = annotation.get("category_id")
            if known and category is not None and category not in trees:
                continue
            short = drop_short_parts(annotation)
            if short and not annotation["segmentation"]:
                self._without_parts.add(annotation["id"])
            else:
                self._tally.left_out += [("polygon_short", annotation["id"])] * short
            masks = masks or bool(annotation.get("segmentation"))
        return masks or not annotations

    def _frames(self, images: list[Entry], trees: list[list[Entry]]) -> list[FrameRecord]:
        """Create the records of some images; boxes and keypoints are rows of two shared arrays."""
        found: list[_TreeEntry] = []
        usable: list[Entry] = []
        ends: list[int] = []
        for image, labels in zip(images, trees, strict=True):
            try:
                self._tally.sized += check_image(image, self._pictures)
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
        paths, size = self._pictures.of(image), (image["width"], image["height"])
        exact = self._pictures.exact(image)
        stride = image.get("depth_exact_stride_px", 1)
        return FrameRecord(image["id"], *paths, *size, extra, trees, exact, stride)

    def _check_tree(self, annotation: Entry, image: Entry, found: list[_TreeEntry]) -> None:
        """Add an annotation to `found` if it is a tree with content.

        Raises:
            EntryError: If it is invalid.
        """
        keypoints = self._names.of(annotation)
        if keypoints is None or self._is_left_out(annotation):
            return
        points = keypoints_of(annotation, keypoints)
        marked, size = flag(annotation, "ignore"), (image["width"], image["height"])
        crowd = flag(annotation, "iscrowd") and not self._is_tree(annotation)
        if annotation.get("segmentation"):
            check_segmentation(annotation, *size)
        elif self._with_masks and not (crowd or marked):
            expected = "polygons or run lengths, because other trees in the file have them"
            refuse(annotation, "annotation", "segmentation", expected)
        truth = named_numbers(annotation, _TRUTH_FIELDS)
        found.append(_TreeEntry(annotation, annotation["bbox"], points, size, truth, crowd, marked))

    def _is_left_out(self, annotation: Entry) -> bool:
        """Whether an annotation has no content or area, or lost its mask; counts it."""
        mask, kind = annotation.get("segmentation"), None
        if not (annotation.get("bbox") or mask or annotation.get("keypoints")):
            kind = "no_content"
        elif not has_area(annotation):
            kind = "box_empty"
        elif not mask and annotation["id"] in self._without_parts:
            is_ignored = flag(annotation, "iscrowd") or flag(annotation, "ignore")
            kind = "mask_short" if self._with_masks and not is_ignored else None
        if kind:
            self._tally.left_out.append((kind, annotation["id"]))
        return kind is not None

    def _is_tree(self, crowd: Entry) -> bool:
        """Whether run lengths with iscrowd 1 are one tree; counts them."""
        if not isinstance(crowd.get("segmentation"), dict):
            return False
        has_keypoints = any((crowd.get("keypoints") or [])[2::3])
        self._tally.crowds_with_keypoints += has_keypoints
        self._tally.crowds_taken += self._crowds_as_trees and not has_keypoints
        self._tally.crowds += not (self._crowds_as_trees or has_keypoints)
        return self._crowds_as_trees or has_keypoints

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
                extra={name: one.entry[name] for name in _TREE_FIELDS if name in one.entry},
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
            self._tally.outside.append((found[row].entry["id"], x, y))
        keypoints[~labelled | outside] = 0.0
        keypoints[..., :2] = np.clip(keypoints[..., :2], 0.0, sizes)
        return keypoints


def _species(annotation: Entry) -> str | None:
    species = annotation.get("species")
    return species if isinstance(species, str) else None
