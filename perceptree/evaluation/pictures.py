"""Detect trees in a folder of unlabelled images; draw them and write them as COCO labels."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from basetree.counts import counted
from basetree.errors import InputError
from basetree.files.names import IMAGE_SUFFIXES
from basetree.files.reading import read_picture
from basetree.files.writing import write_image
from calib import CocoLabels, DepthEncoding, Letterbox, encode_depth, read_depth
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

SKELETON = ((0, 3), (3, 4), (1, 2))
"""The trunk's axis upwards from the felling cut, and the diameter; indices of KEYPOINT_NAMES."""

_JPEG_QUALITY = 92


@dataclass(frozen=True, eq=False)
class FoundTrees:
    """Detections in one image.

    Attributes:
        path: The image file.
        picture: (H, W, 3) BGR uint8, to draw on.
        trees: Detections above the score threshold.
    """

    path: Path
    picture: Picture
    trees: FramePrediction

    def masks(self) -> list[NDArray[np.bool_] | None]:
        """Return an (H, W) bool mask per tree; None for each if the model has no masks."""
        if self.trees.masks is None:
            return [None] * len(self.trees.scores)
        return [np.asarray(coco_mask.decode(dict(runs))).astype(bool) for runs in self.trees.masks]


class _Read(NamedTuple):
    path: Path
    picture: Picture
    image: NDArray[np.uint8]
    letterbox: Letterbox


def find_pictures(folder: Path) -> list[Path]:
    """Return the images in a folder by name.

    Raises:
        DatasetError: If the folder does not exist or has no images.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder, expected a folder with images")
    paths = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")
    )
    if not paths:
        raise DatasetError(f"{folder}: no images, expected {', '.join(IMAGE_SUFFIXES)}")
    return paths


def detect_pictures(
    predict: Predict,
    spec: ModelSpec,
    paths: list[Path],
    score: float,
    batch: int,
    on_error: Callable[[Exception], None],
) -> Iterator[FoundTrees]:
    """Detect trees in images.

    Args:
        predict: The detector.
        spec: Its model.
        paths: Image files.
        score: Smallest score to keep.
        batch: Batch size.
        on_error: Called with the error of each file that is not a readable image of the model's
            modality; the image is left out.

    Yields:
        The trees of each image, highest score first.
    """
    pending: deque[_Read] = deque()

    def images() -> Iterator[tuple[NDArray[np.uint8], Letterbox]]:
        for read in read_ahead(lambda path: _read_or_error(path, spec), paths):
            if isinstance(read, Exception):
                on_error(read)
                continue
            pending.append(read)
            yield read.image, read.letterbox

    for found in predict_images(predict, images(), batch):
        read = pending.popleft()
        yield FoundTrees(read.path, read.picture, _above(found, score))


def _above(found: FramePrediction, score: float) -> FramePrediction:
    kept = np.flatnonzero(found.scores >= score)
    return FramePrediction(
        found.boxes[kept],
        found.scores[kept],
        None if found.keypoints is None else found.keypoints[kept],
        None if found.masks is None else [found.masks[row] for row in kept],
    )


def _read_or_error(path: Path, spec: ModelSpec) -> _Read | DatasetError | InputError:
    try:
        return _read(path, spec)
    except (DatasetError, InputError) as error:
        return error


def _read(path: Path, spec: ModelSpec) -> _Read:
    if spec.depth_encoding is None:
        source: NDArray[np.uint8] = _decoded(path, cv2.IMREAD_COLOR)
        picture: Picture = source
    else:
        source = _read_depth(path, DepthEncoding.from_dict(spec.depth_encoding))
        picture = picture_of_grey(source)
    letterbox = Letterbox.fit(source.shape[1], source.shape[0], spec.width, spec.height)
    return _Read(path, picture, letterbox.apply(source, spec.pad_value), letterbox)


def _read_depth(path: Path, encoding: DepthEncoding) -> NDArray[np.uint8]:
    """Read an 8-bit depth image, or encode one in metres as the model expects."""
    values = _decoded(path, cv2.IMREAD_UNCHANGED)
    if values.dtype == np.uint8 and values.ndim == 2:
        return np.asarray(values, np.uint8)
    if values.dtype == np.uint8:
        raise DatasetError(
            f"{path}: a colour image, expected depth for this model: one channel, 16-bit in"
            " millimetres or 8-bit in the model's depth encoding"
        )
    return encode_depth(read_depth(path), encoding)


def _decoded(path: Path, flag: int) -> NDArray[Any]:
    picture = read_picture(path, flag)
    if picture is None:
        raise DatasetError(f"{path}: not a readable image, expected one")
    return picture.pixels if flag == cv2.IMREAD_UNCHANGED else picture.upright()


def new_labels(checkpoint: str, score: float, runs: bool) -> CocoLabels:
    """Create an empty COCO data set whose description names the checkpoint."""
    return CocoLabels(
        "tree",
        KEYPOINT_NAMES,
        SKELETON,
        f"trees found by {checkpoint} with a score of at least {score:g}, to be corrected",
        runs,
    )


def add_labels(labels: CocoLabels, found: FoundTrees) -> None:
    """Add an image and its trees to the labels."""
    height, width = found.picture.shape[:2]
    labels.add_image(found.path.name, width, height)
    trees = found.trees
    for row, mask in enumerate(found.masks()):
        keypoints = None if trees.keypoints is None else trees.keypoints[row]
        labels.add(trees.boxes[row], trees.scores[row], mask, keypoints)


def write_drawing(found: FoundTrees, path: Path) -> None:
    """Write a JPEG of the image with boxes, outlines and keypoints, and the scores below.

    Raises:
        InputFileError: If the file cannot be written.
    """
    trees, points = found.trees, None
    if trees.keypoints is not None:
        points = trees.keypoints.copy()
        points[..., 2] = 2
    drawn = draw_trees(
        found.picture, boxes=trees.boxes, masks=found.masks(), keypoints=points, weight=1.5
    )
    scores = ", ".join(f"{score:.2f}" for score in trees.scores)
    drawn = with_caption(
        drawn, f"{found.path.name}: {counted(len(trees.scores), 'tree')}  {scores}"
    )
    write_image(path, drawn, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
