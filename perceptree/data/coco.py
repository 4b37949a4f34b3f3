"""COCO files of tree frames: what is on disk, read and checked."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from calib import opencv_to_image
from perceptree.errors import DatasetError

Float = NDArray[np.floating[Any]]

SPLITS = ("train", "val", "test")
KEYPOINTS = 5
_OPTIONAL_METRES = ("distance_m", "diameter_m", "cut_height_m", "inclination_deg")


@dataclass(frozen=True, eq=False)
class TreeRecord:
    """One labelled tree, in source px with (0, 0) at the outer corner of the first pixel.

    ``box_px`` (4,) xyxy; ``keypoints`` (5, 3) x, y, flag; ``segmentation`` as COCO has it;
    ``metres`` the metric truth that the file gives, by field name.
    """

    box_px: Float
    keypoints: Float
    segmentation: Any
    crowd: bool
    metres: dict[str, float]


@dataclass(frozen=True, eq=False)
class FrameRecord:
    """One frame: where its files are, its size in px and its trees."""

    image_id: int
    image_path: Path
    depth_path: Path | None
    depth8_path: Path | None
    width: int
    height: int
    extra: dict[str, Any]
    trees: tuple[TreeRecord, ...]

    def mask(self, tree: TreeRecord) -> NDArray[np.bool_]:
        """(H, W) bool visible pixels of a tree, from RLE or polygons."""
        segmentation = tree.segmentation
        if isinstance(segmentation, list):
            canvas = np.zeros((self.height, self.width), np.uint8)
            # COCO's polygons are corner-based; OpenCV's pixel centres lie on whole numbers.
            for polygon in segmentation:
                corners = np.array(polygon, np.float64).reshape(-1, 2) - 0.5
                cv2.fillPoly(canvas, [np.round(corners * 16).astype(np.int32)], 1, cv2.LINE_8, 4)
            return canvas.astype(bool)
        if isinstance(segmentation["counts"], list):
            segmentation = coco_mask.frPyObjects(segmentation, self.height, self.width)
        return np.asarray(coco_mask.decode(segmentation)).astype(bool)


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
    if not isinstance(content, dict) or not {"images", "annotations"} <= set(content):
        raise DatasetError(f"{path}: expected a COCO file with images and annotations")
    if not content["images"]:
        raise DatasetError(f"{path}: holds no images, expected at least one")
    trees: dict[int, list[dict[str, Any]]] = defaultdict(list)
    for annotation in content["annotations"]:
        trees[annotation["image_id"]].append(annotation)
    try:
        return [_frame(directory, image, trees[image["id"]]) for image in content["images"]]
    except KeyError as error:
        raise DatasetError(f"{path}: an entry lacks the field {error}") from error
    except DatasetError as error:
        raise DatasetError(f"{path}: {error}") from error


def _frame(
    directory: Path, image: dict[str, Any], annotations: list[dict[str, Any]]
) -> FrameRecord:
    def optional(field: str) -> Path | None:
        return directory / image[field] if image.get(field) else None

    extra: dict[str, Any] = {
        name: image[name] for name in ("camera", "up_camera", "scene") if name in image
    }
    return FrameRecord(
        int(image["id"]), directory / image["file_name"], optional("depth_file"),
        optional("depth8_file"), int(image["width"]), int(image["height"]), extra,
        tuple(_tree(annotation) for annotation in annotations),
    )  # fmt: skip


def _tree(annotation: dict[str, Any]) -> TreeRecord:
    number = annotation["id"]
    x, y, width, height = annotation["bbox"]
    if width <= 0 or height <= 0:
        raise DatasetError(f"annotation {number} has box {annotation['bbox']}: expected an area")
    flat = np.array(annotation.get("keypoints", [0] * 3 * KEYPOINTS), np.float64)
    if flat.size != 3 * KEYPOINTS:
        raise DatasetError(
            f"annotation {number} has {flat.size} keypoint values: expected {3 * KEYPOINTS}"
        )
    keypoints = flat.reshape(KEYPOINTS, 3)
    labelled = keypoints[:, 2] > 0
    keypoints[labelled, :2] = opencv_to_image(keypoints[labelled, :2])
    metres = {name: float(annotation[name]) for name in _OPTIONAL_METRES if name in annotation}
    return TreeRecord(
        np.array([x, y, x + width, y + height], np.float64), keypoints,
        annotation["segmentation"], bool(annotation.get("iscrowd", 0)), metres,
    )  # fmt: skip
