"""Frames as model input: decoded and letterboxed, with labels in the same pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import torch

from basetree.arrays import Bool, Float, UInt8
from basetree.errors import InputFileError
from basetree.files.reading import orientation_note, read_picture
from calib import Letterbox
from perceptree.data.coco import FrameRecord, TreeRecord
from perceptree.data.exact import exact_image
from perceptree.data.orientation import as_labelled
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec, TreeTargets


@dataclass(frozen=True, eq=False)
class Sample:
    """One frame in model px (continuous px of the letterboxed image).

    Attributes:
        image: (H, W), (H, W, 3) or (H, W, 4) uint8, see `ModelSpec.image_shape`.
        boxes: (N, 4) x0, y0, x1, y1.
        keypoints: (N, 5, 3) x, y, COCO visibility flag.
        masks: (N, H, W) bool; None if the data has none.
        ignored: (M, 4) x0, y0, x1, y1 of ignored regions: neither trees nor background.
        exact: Whether the image is exact depth, on which a training draws cameras.
    """

    image: UInt8
    boxes: Float
    keypoints: Float
    masks: Bool | None
    ignored: Float = field(default_factory=lambda: np.zeros((0, 4)))
    exact: bool = False

    def targets(self) -> TreeTargets:
        """Return the labels as float32 training targets."""
        return TreeTargets(
            torch.from_numpy(np.asarray(self.boxes, np.float32).reshape(-1, 4)),
            torch.from_numpy(np.asarray(self.keypoints, np.float32).reshape(-1, 5, 3)),
            None if self.masks is None else torch.from_numpy(np.ascontiguousarray(self.masks)),
            torch.from_numpy(np.asarray(self.ignored, np.float32).reshape(-1, 4)),
        )


class FrameStore:
    """The frames of a split as model input, decoded on access."""

    def __init__(self, frames: Sequence[FrameRecord], spec: ModelSpec) -> None:
        self.frames = list(frames)
        self.spec = spec

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Sample:
        """Return frame `index`.

        Raises:
            DatasetError: If its files are missing or broken.
        """
        return load_sample(self.frames[index], self.spec)

    def image(self, index: int) -> UInt8:
        """Return the letterboxed image of frame `index` without its labels.

        Raises:
            DatasetError: If the file is missing or broken.
        """
        return _letterboxed_image(self.frames[index], self.spec)

    @property
    def trees(self) -> int:
        """Number of labelled trees without ignored ones."""
        return sum(not tree.ignored for frame in self.frames for tree in frame.trees)

    def letterbox(self, index: int) -> Letterbox:
        """Return how frame `index` is fitted into the model's input."""
        return _letterbox(self.frames[index], self.spec)


def _letterbox(frame: FrameRecord, spec: ModelSpec) -> Letterbox:
    return Letterbox.fit(frame.width, frame.height, spec.width, spec.height)


def _letterboxed_image(frame: FrameRecord, spec: ModelSpec) -> UInt8:
    _check_encoding(frame, spec)
    return _letterbox(frame, spec).apply(read_frame(frame, spec.modality), spec.pad_values)


def load_sample(frame: FrameRecord, spec: ModelSpec) -> Sample:
    """Decode a frame and letterbox it with its labels.

    Ignored trees are boxes of `ignored` alone. `masks` is None if a tree has no segmentation.

    Raises:
        DatasetError: If a file is missing or broken, or has another size or depth encoding.
    """
    box = _letterbox(frame, spec)
    trees = [tree for tree in frame.trees if not tree.ignored]
    boxes, ignored = (
        np.array([tree.box_px * np.tile(box.scale, 2) for tree in some]).reshape(-1, 4)
        for some in (trees, [tree for tree in frame.trees if tree.ignored])
    )
    keypoints = np.array([tree.keypoints for tree in trees]).reshape(-1, 5, 3).copy()
    keypoints[..., :2] = box.to_model(keypoints[..., :2])
    masks = _masks(frame, trees, spec, box)
    if not frame.reads_exact(spec.modality):
        return Sample(_letterboxed_image(frame, spec), boxes, keypoints, masks, ignored)
    union = np.zeros((spec.height, spec.width), bool)
    for mask in () if masks is None else masks:
        union |= mask
    image = exact_image(frame, spec, box, union)
    return Sample(image, boxes, keypoints, masks, ignored, exact=True)


def _masks(
    frame: FrameRecord, trees: Sequence[TreeRecord], spec: ModelSpec, box: Letterbox
) -> Bool | None:
    """The (N, H, W) masks of some trees in model px; None if one has no segmentation."""
    if any(tree.segmentation is None for tree in trees):
        return None
    masks = np.zeros((len(trees), spec.height, spec.width), bool)
    limit = _half_or_more(spec.height, spec.width)
    for row, tree in enumerate(trees):
        grey = frame.mask(tree).astype(np.uint8) * np.uint8(255)
        masks[row] = box.apply(grey, 0) > limit
    return masks


def _half_or_more(height: int, width: int) -> UInt8:
    """(height, width) limits of a pixel's cover by a mask, in a chessboard of 127 and 128.

    Halving an image makes pixels that are covered by half, 128 when rounded. Every other one
    counts, so that masks keep their width: with one limit, each edge moves by a quarter of a pixel.
    """
    rows, columns = np.indices((height, width))
    return (127 + (rows + columns) % 2).astype(np.uint8)


def _check_encoding(frame: FrameRecord, spec: ModelSpec) -> None:
    """Raise DatasetError if the frame's depth encoding is not the model's."""
    wanted, found = spec.depth_encoding, frame.extra.get("depth_encoding")
    if wanted is not None and found is not None and found != wanted:
        raise DatasetError(
            f"{frame.depth8_path}: its depth_encoding is {found}, expected the model's {wanted}"
        )


def source_paths(frame: FrameRecord, modality: str) -> tuple[Path, ...]:
    """Return the image files that a model of `modality` reads: one, or two of "both".

    Raises:
        DatasetError: If the frame has no depth image.
    """
    kinds = ("rgb", "depth") if modality == "both" else (modality,)
    return tuple(source_path(frame, kind) for kind in kinds)


def source_path(frame: FrameRecord, modality: str) -> Path:
    """Return the image file that a model of `modality` reads, of "both" the colour image.

    Raises:
        DatasetError: If the frame has no depth image.
    """
    path: Path | None = frame.depth8_path if modality == "depth" else frame.image_path
    if path is None:
        raise DatasetError(
            f"{frame.image_path}: the dataset has no 8-bit depth image for it; expected one,"
            " or --modality rgb"
        )
    return path


def read_frame(frame: FrameRecord, modality: str) -> UInt8:
    """Read a frame's image.

    Returns:
        For "rgb" the colour image (H, W, 3) BGR, for "depth" the 8-bit depth (H, W), for "both"
        (H, W, 4) with the depth as the last channel; uint8.

    Raises:
        DatasetError: If the file is missing, unreadable or of another size or type.
    """
    if modality == "both":
        return np.dstack([read_frame(frame, "rgb"), read_frame(frame, "depth")])
    path = source_path(frame, modality)
    flag = cv2.IMREAD_COLOR if modality == "rgb" else cv2.IMREAD_UNCHANGED
    try:
        picture = read_picture(path, flag)
    except InputFileError as error:
        raise DatasetError(str(error)) from error
    if picture is None:
        raise DatasetError(f"{path}: missing or not a readable image, expected one")
    image = as_labelled(picture, frame)
    if image.shape[:2] != (frame.height, frame.width):
        raise DatasetError(
            f"{path}: is {image.shape[1]}x{image.shape[0]} px{orientation_note(path)}, expected"
            f" {frame.width}x{frame.height}"
        )
    if image.dtype != np.uint8 or (modality == "depth" and image.ndim != 2):
        raise DatasetError(f"{path}: expected 8-bit{' single-channel' * (modality == 'depth')}")
    return np.asarray(image, np.uint8)
