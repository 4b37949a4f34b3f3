"""Perfect detectors of the posts, with changes chosen by a test."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from perceptree.data import FrameStore, read_split
from perceptree.evaluation import Predict, RawDetections
from perceptree.models import make_spec

StoreOf = Callable[..., FrameStore]
Change = Callable[[RawDetections], RawDetections]
Oracle = Callable[..., Predict]

ROWS = 20


@pytest.fixture
def store_of() -> StoreOf:
    """The frames of a split as model input, 1.25 times as large."""

    def read(posts: Path, split: str = "train", modality: str = "rgb") -> FrameStore:
        spec = make_spec("edge-n", modality, 96, 160)  # type: ignore[arg-type]
        return FrameStore(read_split(posts, split), spec)

    return read


@pytest.fixture
def oracle() -> Oracle:
    """Recognises a frame by its pixels and returns its labels, then changed."""

    def build(store: FrameStore, change: Change = lambda raw: raw) -> Predict:
        samples = [store[number] for number in range(len(store))]

        def predict(images: np.ndarray) -> RawDetections:
            count = len(images)
            raw = RawDetections(
                np.zeros((count, ROWS, 4), np.float32),
                np.zeros((count, ROWS), np.float32),
                np.zeros((count, ROWS, 5, 3), np.float32),
                np.zeros((count, ROWS, 28, 28), np.float32),
                np.zeros(count, np.int64),
            )
            assert raw.keypoints is not None
            assert raw.masks is not None
            for row, image in enumerate(images):
                sample = next(sample for sample in samples if (sample.image == image).all())
                trees = len(sample.boxes)
                raw.boxes[row, :trees] = sample.boxes
                raw.scores[row, :trees] = 0.9
                raw.keypoints[row, :trees] = sample.keypoints
                raw.masks[row, :trees] = 1.0
                raw.num_detections[row] = trees
            return change(raw)

        return predict

    return build
