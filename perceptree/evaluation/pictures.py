"""Pictures of a folder, without labels: found trees drawn on them, and as labels to correct."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from calib import CocoLabels, DepthEncoding, Letterbox, encode_depth, read_depth
from calib.writing import write_whole
from perceptree.drawing import Picture, draw_trees, with_caption
from perceptree.errors import DatasetError
from perceptree.evaluation.gallery import picture_of_grey
from perceptree.evaluation.predictions import (
    FramePrediction,
    Predict,
    predict_images,
    read_ahead,
)
from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.models import ModelSpec

PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
SKELETON = ((0, 3), (3, 4), (1, 2))
"""The stem's axis from the felling cut up, and the diameter, as indices of KEYPOINT_NAMES."""

_JPEG_QUALITY = 92


@dataclass(frozen=True, eq=False)
class FoundTrees:
    """One picture, (H, W, 3) BGR to draw on, and the trees of it that are sure enough."""

    path: Path
    picture: Picture
    trees: FramePrediction

    def masks(self) -> list[NDArray[np.bool_] | None]:
        """One (H, W) per tree; None where the model gives none."""
        if self.trees.masks is None:
            return [None] * len(self.trees.scores)
        return [np.asarray(coco_mask.decode(dict(runs))).astype(bool) for runs in self.trees.masks]


class _Read(NamedTuple):
    path: Path
    picture: Picture
    image: NDArray[np.uint8]
    letterbox: Letterbox


def find_pictures(folder: Path) -> list[Path]:
    """The pictures of a folder by name; raises DatasetError where there are none."""
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder, expected one with pictures")
    paths = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in PICTURE_SUFFIXES and not path.name.startswith(".")
    )
    if not paths:
        raise DatasetError(f"{folder}: no pictures, expected {', '.join(PICTURE_SUFFIXES)}")
    return paths


def detect_pictures(
    predict: Predict, spec: ModelSpec, paths: list[Path], score: float, batch: int
) -> Iterator[FoundTrees]:
    """The trees of each picture whose score is at least ``score``, best first.

    Raises DatasetError for a file that is no picture, DepthError for one that is no depth.
    """
    waiting: deque[_Read] = deque()

    def images() -> Iterator[tuple[NDArray[np.uint8], Letterbox]]:
        for read in read_ahead(lambda path: _read(path, spec), paths):
            waiting.append(read)
            yield read.image, read.letterbox

    for found in predict_images(predict, images(), batch):
        read = waiting.popleft()
        yield FoundTrees(read.path, read.picture, _above(found, score))


def _above(found: FramePrediction, score: float) -> FramePrediction:
    kept = np.flatnonzero(found.scores >= score)
    return FramePrediction(
        found.boxes[kept],
        found.scores[kept],
        None if found.keypoints is None else found.keypoints[kept],
        None if found.masks is None else [found.masks[row] for row in kept],
    )


def _read(path: Path, spec: ModelSpec) -> _Read:
    if spec.depth_encoding is None:
        source: NDArray[np.uint8] = _decoded(path, cv2.IMREAD_COLOR)
        picture: Picture = source
    else:
        source = _read_grey(path, DepthEncoding.from_dict(spec.depth_encoding))
        picture = picture_of_grey(source)
    letterbox = Letterbox.fit(source.shape[1], source.shape[0], spec.width, spec.height)
    return _Read(path, picture, letterbox.apply(source, spec.pad_value), letterbox)


def _read_grey(path: Path, encoding: DepthEncoding) -> NDArray[np.uint8]:
    """8-bit depth as the model was trained on it, from that or from a depth image in metres."""
    values = _decoded(path, cv2.IMREAD_UNCHANGED)
    if values.dtype == np.uint8 and values.ndim == 2:
        return np.asarray(values, np.uint8)
    if values.dtype == np.uint8:
        raise DatasetError(
            f"{path}: a colour picture, expected depth for this model: one channel of 16 bits in"
            " millimetres, or of 8 bits encoded as the model was trained"
        )
    return encode_depth(read_depth(path), encoding)


def _decoded(path: Path, flag: int) -> NDArray[Any]:
    try:
        image = cv2.imread(str(path), flag)
    except cv2.error:
        image = None
    if image is None:
        raise DatasetError(f"{path}: not a readable picture")
    return image


def new_labels(checkpoint: str, score: float, runs: bool) -> CocoLabels:
    """An empty set of labels that says where it comes from."""
    return CocoLabels(
        "tree",
        KEYPOINT_NAMES,
        SKELETON,
        f"trees that {checkpoint} finds with a score of at least {score:g}, to be corrected",
        runs,
    )


def add_labels(labels: CocoLabels, found: FoundTrees) -> None:
    """The picture and its trees."""
    height, width = found.picture.shape[:2]
    labels.add_image(found.path.name, width, height)
    trees = found.trees
    for row, mask in enumerate(found.masks()):
        keypoints = None if trees.keypoints is None else trees.keypoints[row]
        labels.add(trees.boxes[row], trees.scores[row], mask, keypoints)


def write_drawing(found: FoundTrees, path: Path) -> None:
    """The picture with boxes, outlines and points, and the scores below, as JPEG.

    Raises InputFileError where it cannot be written.
    """
    trees, points = found.trees, None
    if trees.keypoints is not None:
        points = trees.keypoints.copy()
        points[..., 2] = 2
    drawn = draw_trees(
        found.picture, boxes=trees.boxes, masks=found.masks(), keypoints=points, weight=1.5
    )
    scores = ", ".join(f"{score:.2f}" for score in trees.scores)
    drawn = with_caption(drawn, f"{found.path.name}: {len(trees.scores)} trees  {scores}")
    data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
    write_whole(path, data.tobytes())
