"""Prediction of images: reading ahead, and detections in the padding."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pycocotools.mask import decode

import calib
from basetree.errors import SettingsError
from perceptree.data import FrameStore
from perceptree.errors import DatasetError
from perceptree.evaluation import RawDetections, on_device, predict_frames, predict_with, read_ahead
from perceptree.models import TreeRCNN, make_spec

DatasetWriter = Callable[..., Path]


def test_items_are_read_in_order_a_few_ahead() -> None:
    started, lock = [], threading.Lock()

    def read(number: int) -> int:
        with lock:
            started.append(number)
        return number

    for taken, number in enumerate(read_ahead(read, iter(range(1000)))):
        assert number == taken
        assert len(started) <= taken + 12
        if taken == 100:
            break
    assert len(started) < 120  # reading stops when iteration stops


def test_an_error_is_raised_at_the_items_turn() -> None:
    def read(number: int) -> int:
        if number == 5:
            raise DatasetError("the fifth")
        return number

    seen = []
    with pytest.raises(DatasetError, match="the fifth"):
        seen.extend(read_ahead(read, range(50)))
    assert seen == [0, 1, 2, 3, 4]


def test_images_are_not_kept(
    write_dataset: DatasetWriter, store_of: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = store_of(write_dataset(train=40))
    alive, most = [0], [0]

    class Counted(np.ndarray):
        def __del__(self) -> None:
            alive[0] -= 1

    whole = FrameStore.__getitem__

    def counted(self: FrameStore, index: int) -> Any:
        sample = whole(self, index)
        alive[0] += 1
        most[0] = max(most[0], alive[0])
        return type(sample)(sample.image.view(Counted), sample.boxes, sample.keypoints, None)

    monkeypatch.setattr(FrameStore, "__getitem__", counted)

    def nothing(images: np.ndarray) -> RawDetections:
        count = len(images)
        return RawDetections(
            np.zeros((count, 1, 4)), np.zeros((count, 1)), None, None, np.zeros(count, int)
        )

    assert len(list(predict_frames(nothing, store, 4))) == 40
    assert most[0] <= 20


def test_boxes_in_the_padding_are_dropped(posts: Path, store_of: Any) -> None:
    store = store_of(posts)
    spec_rows = 96
    frame_rows = round(72 * 1.25)
    assert frame_rows < spec_rows  # the resized frame ends above the input's lower edge

    def predict(images: np.ndarray) -> RawDetections:
        count = len(images)
        boxes = np.zeros((count, 2, 4), np.float32)
        boxes[:, 0] = [20, 80, 40, 96]  # half in the padding
        boxes[:, 1] = [20, 91, 40, 96]
        masks = np.ones((count, 2, 28, 28), np.float32)
        masks[:, 0, :14] = 0  # the lower half of the box alone
        scores = np.full((count, 2), 0.9, np.float32)
        return RawDetections(boxes, scores, None, masks, np.full(count, 2))

    found = next(iter(predict_frames(predict, store, 1)))
    assert found.boxes.tolist() == [[16, 64, 32, 72]]
    assert found.masks is not None
    cells = np.ones((28, 28), np.float32)
    cells[:14] = 0
    pasted = calib.paste_mask(cells, np.array([16, 64, 32, 76.8]), 128, 72)
    assert found.masks == [calib.encode_rle(pasted)]
    assert not pasted[:70].any()


def test_scores_are_multiplied_by_what_is_known_of_a_frame(posts: Path, store_of: Any) -> None:
    """The chances get the frame's number and what is not in the padding; the order follows."""
    store = store_of(posts)

    def predict(images: np.ndarray) -> RawDetections:
        count = len(images)
        boxes = np.tile(
            np.array([[20, 91, 40, 96], [20, 40, 40, 80], [60, 40, 80, 80]]), (count, 1)
        )
        masks = np.ones((count, 3, 28, 28)) * np.array([0.9, 0.8, 0.7])[:, None, None]
        keypoints = np.zeros((count, 3, 5, 3)) + np.arange(3)[:, None, None]
        return RawDetections(
            boxes.reshape(count, 3, 4).astype(np.float32),
            np.tile(np.array([0.9, 0.8, 0.7]), (count, 1)),
            keypoints,
            masks.astype(np.float32),
            np.full(count, 3),
        )

    seen = []

    def chances(number: int, boxes_px: np.ndarray, masks: np.ndarray) -> np.ndarray:
        seen.append((number, boxes_px.tolist(), masks[:, 0, 0].tolist()))
        return np.array([0.5, 1.0])

    found = list(predict_frames(predict, store, 2, chances))
    left, right = [16, 32, 32, 64], [48, 32, 64, 64]
    shares = pytest.approx([0.8, 0.7])
    assert seen == [(number, [left, right], shares) for number in range(len(store))]
    for frame in found:
        assert frame.scores.tolist() == pytest.approx([0.7, 0.4])
        assert frame.boxes.tolist() == [right, left]
        assert frame.keypoints is not None
        assert frame.keypoints[:, 0, 2].tolist() == [2, 1]
        assert frame.masks is not None
        assert np.flatnonzero(decode(frame.masks[0]).any(axis=0))[0] == 48


def test_predict_with_returns_numpy_arrays() -> None:
    model = TreeRCNN(make_spec("edge-n", "depth", 64, 64, fpn_width=32, masks=False)).eval()
    raw = predict_with(on_device(model, "cpu"))(np.zeros((2, 64, 64), np.uint8))
    assert raw.boxes.shape[0] == 2
    assert raw.masks is None
    assert isinstance(raw.keypoints, np.ndarray)


def test_a_missing_device_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    model = TreeRCNN(make_spec("edge-n", "depth", 64, 64, fpn_width=32))
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(SettingsError, match="--device is cuda: expected a GPU"):
        on_device(model, "cuda")
    with pytest.raises(SettingsError, match="--device is 'tpu': expected cpu or cuda"):
        on_device(model, "tpu")
