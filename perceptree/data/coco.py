"""COCO files of tree frames: what is on disk, read and checked."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from calib import opencv_to_image
from perceptree.errors import DatasetError

Float = NDArray[np.floating[Any]]

SPLITS = ("train", "val", "test")
KEYPOINTS = 5
_TRUTH_FIELDS = ("distance_m", "diameter_m", "cut_height_m", "inclination_deg", "visible_fraction")
_FRAME_FIELDS = ("camera", "up_camera", "depth_encoding", "scene")


@dataclass(frozen=True, eq=False)
class TreeRecord:
    """One labelled tree, in source px with (0, 0) at the outer corner of the first pixel.

    ``box_px`` (4,) xyxy; ``keypoints`` (5, 3) x, y, flag; ``segmentation`` as COCO has it;
    ``truth`` the metric truth that the file gives, by field name.
    """

    number: int
    box_px: Float
    keypoints: Float
    segmentation: Any
    crowd: bool
    truth: dict[str, float]


@dataclass(frozen=True, eq=False)
class FrameRecord:
    """One frame: where its files are, its size in px and its trees.

    ``extra`` holds what the file gives of camera, up_camera, depth_encoding and scene.
    """

    image_id: int
    image_path: Path
    depth_path: Path | None
    depth8_path: Path | None
    width: int
    height: int
    extra: dict[str, Any]
    trees: tuple[TreeRecord, ...]

    def mask(self, tree: TreeRecord) -> NDArray[np.bool_]:
        """(H, W) bool visible pixels of a tree, from RLE or polygons.

        Raises DatasetError for runs that do not fill the frame.
        """
        segmentation = tree.segmentation
        try:
            if isinstance(segmentation, list):
                parts = coco_mask.frPyObjects(segmentation, self.height, self.width)
                segmentation = coco_mask.merge(parts)
            elif isinstance(segmentation["counts"], list):
                segmentation = coco_mask.frPyObjects(segmentation, self.height, self.width)
            pixels = np.asarray(coco_mask.decode(segmentation))
        except (ValueError, TypeError, OverflowError) as error:
            self._refuse_runs(tree, error)
        # Runs that end early leave memory as it was, which is no mask.
        if pixels.sum(dtype=np.int64) != coco_mask.area(segmentation):
            self._refuse_runs(tree, None)
        return pixels.astype(bool)

    def _refuse_runs(self, tree: TreeRecord, cause: Exception | None) -> NoReturn:
        raise DatasetError(
            f"{self.image_path}: the segmentation of annotation {tree.number} is broken:"
            f" expected runs that fill {self.width}x{self.height} px"
        ) from cause


def read_split(directory: Path | str, split: str) -> list[FrameRecord]:
    """The frames of ``{split}_RGB.json`` in a dataset's folder.

    Raises DatasetError, in one line, for a missing file, one that is not COCO, or a label that
    contradicts its frame.
    """
    directory = Path(directory)
    path = directory / f"{split}_RGB.json"
    if not path.is_file():
        raise DatasetError(f"{path}: no such file, expected a dataset with {split}_RGB.json")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path}: not readable JSON ({error})") from error
    try:
        return _frames(directory, content)
    except DatasetError as error:
        raise DatasetError(f"{path}: {error}") from error


def _frames(directory: Path, content: Any) -> list[FrameRecord]:
    if not isinstance(content, dict):
        raise DatasetError("expected a COCO file with images and annotations")
    images, annotations = (_rows(content, name) for name in ("images", "annotations"))
    if not images:
        raise DatasetError("holds no images, expected at least one")
    trees: dict[int, list[dict[str, Any]]] = {_whole(i, "image", "id"): [] for i in images}
    if len(trees) < len(images):
        raise DatasetError("some images share an id, expected each once")
    for annotation in annotations:
        owner = _whole(annotation, "annotation", "image_id")
        if owner not in trees:
            _refuse(annotation, "annotation", "image_id", "one of the images' ids")
        trees[owner].append(annotation)
    return [_frame(directory, image, trees[image["id"]]) for image in images]


def _frame(
    directory: Path, image: dict[str, Any], annotations: list[dict[str, Any]]
) -> FrameRecord:
    paths: dict[str, Path | None] = {}
    for field in ("file_name", "depth_file", "depth8_file"):
        name = image.get(field)
        if not (isinstance(name, str) and name) and (field == "file_name" or name is not None):
            _refuse(image, "image", field, "the path of a file within the dataset")
        paths[field] = None if name is None else directory / name
    width, height = (_whole(image, "image", field) for field in ("width", "height"))
    for field, size in (("width", width), ("height", height)):
        if size < 1:
            _refuse(image, "image", field, "at least 1 px")
    return FrameRecord(
        image["id"], paths["file_name"] or directory, paths["depth_file"], paths["depth8_file"],
        width, height, {name: image[name] for name in _FRAME_FIELDS if name in image},
        tuple(_tree(annotation, width, height) for annotation in annotations),
    )  # fmt: skip


def _tree(annotation: dict[str, Any], width: int, height: int) -> TreeRecord:
    number = _whole(annotation, "annotation", "id")
    x, y, box_width, box_height = _numbers(annotation, "bbox", 4)
    if box_width <= 0 or box_height <= 0:
        _refuse(annotation, "annotation", "bbox", "a width and height over 0")
    keypoints = np.zeros((KEYPOINTS, 3))
    if "keypoints" in annotation:
        keypoints = np.array(_numbers(annotation, "keypoints", 3 * KEYPOINTS)).reshape(-1, 3)
    if not np.isin(keypoints[:, 2], (0, 1, 2)).all():
        _refuse(annotation, "annotation", "keypoints", "flags of 0, 1 or 2")
    labelled = keypoints[:, 2] > 0
    keypoints[labelled, :2] = opencv_to_image(keypoints[labelled, :2])
    _check_segmentation(annotation, width, height)
    truth = {name: _numbers(annotation, name, 1)[0] for name in _TRUTH_FIELDS if name in annotation}
    return TreeRecord(
        number, np.array([x, y, x + box_width, y + box_height]), keypoints,
        annotation["segmentation"], bool(annotation.get("iscrowd", 0)), truth,
    )  # fmt: skip


def _check_segmentation(annotation: dict[str, Any], width: int, height: int) -> None:
    segmentation = annotation.get("segmentation")
    if isinstance(segmentation, dict):
        runs, size = segmentation.get("counts"), segmentation.get("size")
        fits = isinstance(runs, str | list) and size == [height, width]
    else:
        fits = (
            isinstance(segmentation, list)
            and segmentation
            and all(
                _are_numbers(polygon) and len(polygon) >= 6 and len(polygon) % 2 == 0
                for polygon in segmentation
            )
        )
    if not fits:
        expected = f"polygons x, y, ... or runs of size [{height}, {width}]"
        _refuse(annotation, "annotation", "segmentation", expected)


def _rows(content: dict[str, Any], name: str) -> list[dict[str, Any]]:
    rows = content.get(name)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise DatasetError(f"expected a COCO file with a list of {name}")
    return rows


def _whole(entry: dict[str, Any], kind: str, field: str) -> int:
    value = entry.get(field)
    if isinstance(value, bool) or not isinstance(value, int):
        _refuse(entry, kind, field, "a whole number")
    return value


def _numbers(annotation: dict[str, Any], field: str, count: int) -> list[float]:
    """A field's ``count`` finite numbers; a single one stands alone in the file."""
    value = annotation.get(field)
    values = [value] if count == 1 else value
    if not isinstance(values, list) or len(values) != count or not _are_numbers(values):
        _refuse(annotation, "annotation", field, f"{count} finite number{'s' * (count > 1)}")
    return [float(number) for number in values]


def _are_numbers(values: Any) -> bool:
    return isinstance(values, list) and all(
        isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        for value in values
    )


def _refuse(entry: dict[str, Any], kind: str, field: str, expected: str) -> NoReturn:
    """Say which entry of the file has which field wrong."""
    value = repr(entry[field]) if field in entry else "missing"
    shown = value if len(value) <= 60 else value[:57] + "..."
    raise DatasetError(f"{field} of {kind} {entry.get('id', '?')} is {shown}, expected {expected}")
