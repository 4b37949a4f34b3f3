"""Frames in memory: decoded and letterboxed once, so that training only augments them."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from calib import Letterbox
from perceptree.data.coco import FrameRecord
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec, TreeTargets

Float = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Sample:
    """One frame in model px: image uint8 (H, W) or (H, W, 3), boxes (N, 4) xyxy, keypoints
    (N, 5, 3) x, y, flag, masks (N, H, W) bool."""

    image: NDArray[np.uint8]
    boxes: Float
    keypoints: Float
    masks: NDArray[np.bool_]

    def targets(self) -> TreeTargets:
        """The trees as the model trains on them."""
        return TreeTargets(
            torch.from_numpy(np.asarray(self.boxes, np.float32).reshape(-1, 4)),
            torch.from_numpy(np.asarray(self.keypoints, np.float32).reshape(-1, 5, 3)),
            torch.from_numpy(np.ascontiguousarray(self.masks)),
        )


@dataclass(frozen=True, eq=False)
class _Stored:
    image: NDArray[np.uint8]
    boxes: Float
    keypoints: Float
    packed_masks: NDArray[np.uint8]


class FrameStore:
    """All frames of a split as a model wants them; masks are kept packed to bits."""

    def __init__(self, frames: Sequence[FrameRecord], spec: ModelSpec) -> None:
        self.frames = list(frames)
        self.spec = spec
        with ThreadPoolExecutor() as pool:
            self._stored = list(pool.map(self._load, self.frames))

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Sample:
        stored = self._stored[index]
        shape = (len(stored.boxes), self.spec.height, self.spec.width)
        masks = np.unpackbits(stored.packed_masks, axis=-1, count=self.spec.width)
        return Sample(
            stored.image, stored.boxes, stored.keypoints, masks.reshape(shape).astype(bool)
        )

    @property
    def trees(self) -> int:
        """How many trees are labelled, crowds left out."""
        return sum(len(stored.boxes) for stored in self._stored)

    def letterbox(self, index: int) -> Letterbox:
        """How frame ``index`` was fitted into the model's input."""
        frame = self.frames[index]
        return Letterbox.fit(frame.width, frame.height, self.spec.width, self.spec.height)

    def _load(self, frame: FrameRecord) -> _Stored:
        box = Letterbox.fit(frame.width, frame.height, self.spec.width, self.spec.height)
        self._check_encoding(frame)
        image = box.apply(read_frame(frame, self.spec.modality), self.spec.pad_value)
        trees = [tree for tree in frame.trees if not tree.crowd]
        scale = np.tile(box.scale, 2)
        boxes = np.array([tree.box_px * scale for tree in trees]).reshape(-1, 4)
        keypoints = np.array([tree.keypoints for tree in trees]).reshape(-1, 5, 3).copy()
        keypoints[..., :2] = box.to_model(keypoints[..., :2])
        masks = np.zeros((len(trees), self.spec.height, self.spec.width), bool)
        for row, tree in enumerate(trees):
            grey = frame.mask(tree).astype(np.uint8) * np.uint8(255)
            masks[row] = box.apply(grey, 0) > 127
        return _Stored(image, boxes, keypoints, np.packbits(masks, axis=-1))

    def _check_encoding(self, frame: FrameRecord) -> None:
        """A model of depth sees the greys that its spec says, and no others."""
        wanted, found = self.spec.depth_encoding, frame.extra.get("depth_encoding")
        if wanted is not None and found is not None and found != wanted:
            raise DatasetError(
                f"{frame.depth8_path}: its depth_encoding is {found}, expected the model's {wanted}"
            )


def read_frame(frame: FrameRecord, modality: str) -> NDArray[np.uint8]:
    """The frame's colour image (H, W, 3) BGR, or its 8-bit depth (H, W).

    Raises DatasetError for a file that is missing, unreadable or of another size.
    """
    path: Path | None = frame.image_path if modality == "rgb" else frame.depth8_path
    if path is None:
        raise DatasetError(f"{frame.image_path}: the dataset gives no 8-bit depth beside it")
    flag = cv2.IMREAD_COLOR if modality == "rgb" else cv2.IMREAD_UNCHANGED
    image = cv2.imread(str(path), flag) if path.is_file() else None
    if image is None:
        raise DatasetError(f"{path}: missing or not a readable image")
    if image.shape[:2] != (frame.height, frame.width):
        raise DatasetError(
            f"{path}: is {image.shape[1]}x{image.shape[0]} px, expected"
            f" {frame.width}x{frame.height}"
        )
    if image.dtype != np.uint8 or (modality == "depth" and image.ndim != 2):
        raise DatasetError(f"{path}: expected 8-bit{' single-channel' * (modality == 'depth')}")
    return np.asarray(image, np.uint8)
