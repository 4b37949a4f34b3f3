"""Predictions of a detector in source px, independent of the runtime."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import Any, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from basetree.arrays import Float, UInt8
from basetree.errors import SettingsError
from calib import CocoRle, Letterbox, encode_rle, paste_mask
from perceptree.data import FrameStore
from perceptree.models import TreeRCNN
from perceptree.models.scores import mask_certainty

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

DEVICES = ("cpu", "cuda")
_READERS = 3
_PREFETCH = 8


class RawDetections(NamedTuple):
    """Output of a model for a batch of B images with up to K detections each, in model px.

    Attributes:
        boxes: (B, K, 4) x0, y0, x1, y1.
        scores: (B, K) scores, 0 to 1.
        keypoints: (B, K, 5, 3) x, y, score; None without a keypoint branch.
        masks: (B, K, 28, 28) probabilities inside the boxes; None without a mask branch.
        num_detections: (B,) number of valid detections.
    """

    boxes: Float
    scores: Float
    keypoints: Float | None
    masks: Float | None
    num_detections: NDArray[np.integer[Any]]


Predict = Callable[[UInt8], RawDetections]
Chances = Callable[[int, Float, Float], Float]
"""What is known of trees besides the model: from the number of a frame, (N, 4) boxes in continuous
source px and (N, 28, 28) masks inside them to (N,) factors of the scores, 0 to 1."""


class FramePrediction(NamedTuple):
    """Detections in one frame in continuous source px, highest score first.

    Attributes:
        boxes: (N, 4) x0, y0, x1, y1.
        scores: (N,) scores, 0 to 1.
        keypoints: (N, 5, 3) x, y, score; None without a keypoint branch.
        masks: N masks of the frame's size as COCO run lengths; None without a mask branch.
        certainty: (N,) how certain the masks are, see `perceptree.models.scores.mask_certainty`;
            None if it is not known.
    """

    boxes: Float
    scores: Float
    keypoints: Float | None
    masks: list[CocoRle] | None
    certainty: Float | None = None


def on_device(model: TreeRCNN, device: str) -> TreeRCNN:
    """Move a model to "cpu" or "cuda".

    Raises:
        SettingsError: If the device is unknown or not available.
    """
    if device not in DEVICES:
        raise SettingsError(f"--device is {device!r}: expected {' or '.join(DEVICES)}")
    if device == "cuda" and not torch.cuda.is_available():
        raise SettingsError("--device is cuda: expected a GPU that torch can use, or cpu")
    return model.to(device)


def predict_with(model: TreeRCNN) -> Predict:
    """Return a function that runs a model in eval mode on (B, H, W[, 3]) uint8 batches."""

    def predict(images: UInt8) -> RawDetections:
        device = next(model.parameters()).device
        with torch.inference_mode():
            found = model.detect(torch.from_numpy(images).to(device))
        arrays = {name: value.cpu().numpy() for name, value in found._asdict().items()}
        return RawDetections(
            arrays["boxes"],
            arrays["scores"],
            arrays["keypoints"] if model.spec.keypoints else None,
            arrays["masks"] if model.spec.masks else None,
            arrays["num_detections"],
        )

    return predict


def predict_frames(
    predict: Predict, store: FrameStore, batch: int, chances: Chances | None = None
) -> Iterator[FramePrediction]:
    """Run a detector on all frames.

    Images are read a few ahead and not kept. The last batch is padded to full size.

    Args:
        predict: The detector.
        store: The frames.
        batch: Batch size.
        chances: By which the scores of a model with masks are multiplied; None for none.
    """

    def read(number: int) -> tuple[UInt8, Letterbox]:
        return store.image(number), store.letterbox(number)

    return predict_images(predict, read_ahead(read, range(len(store))), batch, chances)


def predict_images(
    predict: Predict,
    images: Iterable[tuple[UInt8, Letterbox]],
    batch: int,
    chances: Chances | None = None,
) -> Iterator[FramePrediction]:
    """Run a detector on letterboxed images.

    Args:
        predict: The detector.
        images: Images at the model's input size, with their letterboxes.
        batch: Batch size; the last batch is padded to full size.
        chances: As for `predict_frames`; frames are numbered as `images` come.
    """
    remaining = iter(enumerate(images))
    while group := list(islice(remaining, batch)):
        pixels = [image for _, (image, _) in group]
        filled = pixels + pixels[-1:] * (batch - len(pixels))
        raw = predict(np.stack(filled))
        for row, (number, (_, letterbox)) in enumerate(group):
            yield _in_source(raw, row, letterbox, number, chances)


def read_ahead(read: Callable[[_Item], _Result], items: Iterable[_Item]) -> Iterator[_Result]:
    """Yield `read(item)` in order; a few threads read a few items ahead."""
    rest = iter(items)
    with ThreadPoolExecutor(_READERS) as pool:
        pending: deque[Future[_Result]] = deque(
            pool.submit(read, item) for item in islice(rest, _PREFETCH)
        )
        try:
            while pending:
                result = pending.popleft().result()
                pending.extend(pool.submit(read, item) for item in islice(rest, 1))
                yield result
        finally:
            for future in pending:
                future.cancel()


def _in_source(
    raw: RawDetections, row: int, letterbox: Letterbox, number: int, chances: Chances | None
) -> FramePrediction:
    count = int(raw.num_detections[row])
    size = letterbox.source_width, letterbox.source_height
    boxes = raw.boxes[row, :count].astype(np.float64) / np.tile(letterbox.scale, 2)
    scores = raw.scores[row, :count].astype(np.float64)
    kept = np.flatnonzero((boxes[:, :2] < size).all(axis=1))  # the others are in the padding
    if chances is not None and raw.masks is not None:
        scores[kept] *= chances(number, boxes[kept], raw.masks[row, kept])
        kept = kept[np.argsort(-scores[kept], kind="stable")]
    keypoints = None
    if raw.keypoints is not None:
        keypoints = raw.keypoints[row, kept].astype(np.float64)
        keypoints[..., :2] = letterbox.to_source(keypoints[..., :2])
    masks = certainty = None
    if raw.masks is not None:
        cells = raw.masks[row, kept]
        certainty = mask_certainty(torch.from_numpy(cells)).double().numpy()
        pasted = (
            paste_mask(grid, box, *size) for grid, box in zip(cells, boxes[kept], strict=True)
        )
        masks = [encode_rle(mask) for mask in pasted]
    boxes = np.clip(boxes[kept], 0, np.tile(size, 2))
    return FramePrediction(boxes, scores[kept], keypoints, masks, certainty)
