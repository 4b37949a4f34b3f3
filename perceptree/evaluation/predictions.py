"""What a detector says of frames, in the frames' own pixels, whichever runtime said it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import Any, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from calib import CocoRle, Letterbox, encode_rle, paste_mask
from perceptree.data import FrameStore
from perceptree.errors import SettingsError
from perceptree.models import TreeRCNN

Float = NDArray[np.floating[Any]]
_Item = TypeVar("_Item")
_Made = TypeVar("_Made")

DEVICES = ("cpu", "cuda")
_READERS = 3
_AHEAD = 8


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
    """One frame's trees in source px, best first: boxes (N, 4), scores (N,), keypoints (N, 5, 3)
    x, y, score, and masks of the frame's size as COCO's runs."""

    boxes: Float
    scores: Float
    keypoints: Float | None
    masks: list[CocoRle] | None


def on_device(model: TreeRCNN, device: str) -> TreeRCNN:
    """The model, moved to ``cpu`` or ``cuda``; raises SettingsError for what is not there."""
    if device not in DEVICES:
        raise SettingsError(f"--device is {device!r}: expected {' or '.join(DEVICES)}")
    if device == "cuda" and not torch.cuda.is_available():
        raise SettingsError("--device is cuda: expected a GPU that torch can use, or cpu")
    return model.to(device)


def predict_with(model: TreeRCNN) -> Predict:
    """A model in eval mode as a function of uint8 batches at its input size, on its own device."""

    def predict(images: NDArray[np.uint8]) -> RawDetections:
        device = next(model.parameters()).device
        with torch.inference_mode():
            found = model.detect(torch.from_numpy(images).to(device))
        boxes, scores, keypoints, masks, count = (value.cpu().numpy() for value in found)
        return RawDetections(
            boxes,
            scores,
            keypoints if model.spec.keypoints else None,
            masks if model.spec.masks else None,
            count,
        )

    return predict


def predict_frames(predict: Predict, store: FrameStore, batch: int) -> Iterator[FramePrediction]:
    """Run ``predict`` over all frames, ``batch`` at a time; a last short batch is filled up.

    Pictures are read a few ahead and kept no longer than they are needed.
    """

    def read(number: int) -> tuple[NDArray[np.uint8], Letterbox]:
        return store.image(number), store.letterbox(number)

    return predict_images(predict, read_ahead(read, range(len(store))), batch)


def predict_images(
    predict: Predict, images: Iterable[tuple[NDArray[np.uint8], Letterbox]], batch: int
) -> Iterator[FramePrediction]:
    """Run ``predict`` over pictures that have the model's size, and how they came to it."""
    waiting = iter(images)
    while together := list(islice(waiting, batch)):
        pixels = [image for image, _ in together]
        filled = pixels + pixels[-1:] * (batch - len(pixels))
        raw = predict(np.stack(filled))
        for row, (_, letterbox) in enumerate(together):
            yield _in_source(raw, row, letterbox)


def read_ahead(read: Callable[[_Item], _Made], items: Iterable[_Item]) -> Iterator[_Made]:
    """``read`` of every item in turn, by a few threads, a few items ahead of who takes them."""
    rest = iter(items)
    with ThreadPoolExecutor(_READERS) as pool:
        pending: deque[Future[_Made]] = deque(
            pool.submit(read, item) for item in islice(rest, _AHEAD)
        )
        try:
            while pending:
                made = pending.popleft().result()
                pending.extend(pool.submit(read, item) for item in islice(rest, 1))
                yield made
        finally:
            for future in pending:
                future.cancel()


def _in_source(raw: RawDetections, row: int, letterbox: Letterbox) -> FramePrediction:
    count = int(raw.num_detections[row])
    size = letterbox.source_width, letterbox.source_height
    boxes = raw.boxes[row, :count].astype(np.float64) / np.tile(letterbox.scale, 2)
    seen = (boxes[:, :2] < size).all(axis=1)  # the others lie in the padding
    keypoints = None
    if raw.keypoints is not None:
        keypoints = raw.keypoints[row, :count][seen].astype(np.float64)
        keypoints[..., :2] = letterbox.to_source(keypoints[..., :2])
    masks = None
    if raw.masks is not None:
        cells = raw.masks[row, :count][seen]
        pasted = (
            paste_mask(grid, box, *size) for grid, box in zip(cells, boxes[seen], strict=True)
        )
        masks = [encode_rle(mask) for mask in pasted]
    scores = raw.scores[row, :count][seen].astype(np.float64)
    return FramePrediction(np.clip(boxes[seen], 0, np.tile(size, 2)), scores, keypoints, masks)
