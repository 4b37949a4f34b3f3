"""What a detector says of frames, in the frames' own pixels, whichever runtime said it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from calib import Letterbox
from perceptree.data import FrameStore
from perceptree.models import TreeRCNN

Float = NDArray[np.floating[Any]]


class RawDetections(NamedTuple):
    """A batch as the model gives it: (B, K, 4), (B, K), (B, K, 5, 3), (B, K, 28, 28), (B,).

    ``keypoints`` or ``masks`` is None where the model has no such branch.
    """

    boxes: Float
    scores: Float
    keypoints: Float | None
    masks: Float | None
    num_detections: NDArray[np.integer[Any]]


Predict = Callable[[NDArray[np.uint8]], RawDetections]


class FramePrediction(NamedTuple):
    """One frame's trees in source px: boxes (N, 4), scores (N,), keypoints (N, 5, 3), RLE masks."""

    boxes: Float
    scores: Float
    keypoints: Float | None
    masks: list[Any] | None


def predict_with(model: TreeRCNN) -> Predict:
    """A model in eval mode as a function of uint8 batches at its input size."""

    def predict(images: NDArray[np.uint8]) -> RawDetections:
        with torch.inference_mode():
            found = model.detect(torch.from_numpy(images))
        return RawDetections(
            found.boxes.numpy(),
            found.scores.numpy(),
            found.keypoints.numpy() if model.spec.keypoints else None,
            found.masks.numpy() if model.spec.masks else None,
            found.num_detections.numpy(),
        )

    return predict


def predict_frames(predict: Predict, store: FrameStore, batch: int) -> Iterator[FramePrediction]:
    """Run ``predict`` over all frames, ``batch`` at a time; a last short batch is filled up."""
    for start in range(0, len(store), batch):
        numbers = list(range(start, min(start + batch, len(store))))
        filled = numbers + numbers[-1:] * (batch - len(numbers))
        raw = predict(np.stack([store[number].image for number in filled]))
        for row, number in enumerate(numbers):
            yield _in_source(raw, row, store.letterbox(number))


def _in_source(raw: RawDetections, row: int, letterbox: Letterbox) -> FramePrediction:
    count = int(raw.num_detections[row])
    size = letterbox.source_width, letterbox.source_height
    boxes = raw.boxes[row, :count].astype(np.float64) / np.tile(letterbox.scale, 2)
    boxes = np.clip(boxes, 0, np.tile(size, 2))
    keypoints = None
    if raw.keypoints is not None:
        keypoints = raw.keypoints[row, :count].astype(np.float64)
        keypoints[..., :2] = letterbox.to_source(keypoints[..., :2])
    masks = None
    if raw.masks is not None:
        cells = raw.masks[row, :count]
        masks = [_rle(grid, box, *size) for grid, box in zip(cells, boxes, strict=True)]
    return FramePrediction(boxes, raw.scores[row, :count].astype(np.float64), keypoints, masks)


def _rle(cells: Float, box: Float, width: int, height: int) -> Any:
    """Mask cells inside a box, sampled bilinearly at pixel centres and cut at one half."""
    x0, y0, x1, y1 = box
    size = cells.shape[0]
    sx, sy = (x1 - x0) / size, (y1 - y0) / size
    # Cell centres to pixel centres, both on OpenCV's whole numbers.
    matrix = np.array([[sx, 0, x0 + (sx - 1) / 2], [0, sy, y0 + (sy - 1) / 2]])
    if min(sx, sy) <= 0:
        pasted = np.zeros((height, width), np.uint8)
    else:
        probability = cv2.warpAffine(
            cells.astype(np.float32), matrix, (width, height), flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=(0.0,),
        )  # fmt: skip
        pasted = (probability >= 0.5).astype(np.uint8)
    return coco_mask.encode(np.asfortranarray(pasted))
