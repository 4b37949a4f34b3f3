"""COCO average precision of boxes, masks and keypoints, and keypoint errors in pixels."""

from __future__ import annotations

import contextlib
import dataclasses
import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from perceptree.data import FrameRecord, FrameStore
from perceptree.errors import DatasetError
from perceptree.evaluation.predictions import FramePrediction, Predict, predict_frames
from perceptree.models import KEYPOINT_NAMES

Float = NDArray[np.floating[Any]]

OKS_SIGMAS = (0.25,) * len(KEYPOINT_NAMES)
_MATCH_IOU = 0.5
_DISPLAY_SCORE = 0.5


@dataclass(frozen=True)
class Metrics:
    """COCO AP and AP50 in percent, and what they were taken on; None without branch or labels.

    ``keypoint_error_px`` is the median distance of each keypoint from the truth, in source px,
    over trees matched at box IoU 0.5 with a score of at least 0.5.
    """

    frames: int
    trees: int
    box_ap: float
    box_ap50: float
    mask_ap: float | None
    mask_ap50: float | None
    keypoint_ap: float | None
    keypoint_ap50: float | None
    keypoint_error_px: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return dataclasses.asdict(self)


def evaluate(
    predict: Predict,
    store: FrameStore,
    batch: int = 1,
    progress: Callable[[int], None] = lambda frames: None,
) -> Metrics:
    """Average precision of ``predict`` over all frames of ``store``, up to 20 trees a frame.

    ``progress`` gets the number of frames done since its last call. Raises DatasetError where
    ``store`` has no labelled tree: then precision means nothing.
    """
    if store.trees == 0:
        raise DatasetError(f"{len(store)} frames without a labelled tree: expected some trees")
    predictions = []
    for prediction in predict_frames(predict, store, batch):
        predictions.append(prediction)
        progress(1)
    truth = _ground_truth(store.frames)
    results = {
        kind: _average_precision(truth, predictions, store.frames, kind)
        for kind in ("bbox", "segm", "keypoints")
    }
    return Metrics(
        len(store.frames),
        store.trees,
        results["bbox"][0] or 0.0,
        results["bbox"][1] or 0.0,
        *results["segm"],
        *results["keypoints"],
        _keypoint_errors(store.frames, predictions),
    )


def _ground_truth(frames: list[FrameRecord]) -> COCO:
    annotations: list[dict[str, Any]] = []
    for frame in frames:
        for tree in frame.trees:
            x0, y0, x1, y1 = tree.box_px.tolist()
            mask = frame.mask(tree)
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": frame.image_id,
                    "category_id": 1,
                    "bbox": [x0, y0, x1 - x0, y1 - y0],
                    "area": float(mask.sum()),
                    "iscrowd": int(tree.crowd),
                    "segmentation": tree.segmentation,
                    "keypoints": tree.keypoints.ravel().tolist(),
                    "num_keypoints": int((tree.keypoints[:, 2] > 0).sum()),
                }
            )
    coco = COCO()
    coco.dataset = {
        "info": {},
        "images": [{"id": f.image_id, "width": f.width, "height": f.height} for f in frames],
        "annotations": annotations,
        "categories": [{"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES)}],
    }
    with contextlib.redirect_stdout(io.StringIO()):
        coco.createIndex()
    return coco


def _results(
    frames: list[FrameRecord], predictions: list[FramePrediction], kind: str
) -> list[dict[str, Any]] | None:
    """COCO's result entries; None where the model lacks the branch."""
    entries = []
    for frame, found in zip(frames, predictions, strict=True):
        if (kind == "segm" and found.masks is None) or (
            kind == "keypoints" and found.keypoints is None
        ):
            return None
        for row, (box, score) in enumerate(zip(found.boxes, found.scores, strict=True)):
            x0, y0, x1, y1 = box.tolist()
            entry: dict[str, Any] = {
                "image_id": frame.image_id,
                "category_id": 1,
                "score": float(score),
            }
            if kind == "segm" and found.masks is not None:
                entry["segmentation"] = found.masks[row]
            elif kind == "keypoints" and found.keypoints is not None:
                entry["keypoints"] = found.keypoints[row].ravel().tolist()
            else:
                entry["bbox"] = [x0, y0, x1 - x0, y1 - y0]
            entries.append(entry)
    return entries


def _average_precision(
    truth: COCO, predictions: list[FramePrediction], frames: list[FrameRecord], kind: str
) -> tuple[float | None, float | None]:
    entries = _results(frames, predictions, kind)
    if entries is None:
        return None, None
    if not entries:
        return 0.0, 0.0
    with contextlib.redirect_stdout(io.StringIO()):
        evaluation = COCOeval(truth, truth.loadRes(entries), kind)
        if kind == "keypoints":
            evaluation.params.kpt_oks_sigmas = np.array(OKS_SIGMAS)
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    ap, ap50 = (100 * float(value) for value in evaluation.stats[:2])
    return (None, None) if ap < 0 else (ap, ap50)  # -1 where no tree has such a label


def _keypoint_errors(
    frames: list[FrameRecord], predictions: list[FramePrediction]
) -> dict[str, float]:
    errors: list[list[float]] = [[] for _ in KEYPOINT_NAMES]
    for frame, found in zip(frames, predictions, strict=True):
        if found.keypoints is None:
            return {}
        sure = found.scores >= _DISPLAY_SCORE
        boxes, keypoints = found.boxes[sure], found.keypoints[sure]
        for tree in frame.trees:
            overlap = _iou(tree.box_px, boxes)
            if not len(overlap) or overlap.max() < _MATCH_IOU:
                continue
            gap = keypoints[int(overlap.argmax()), :, :2] - tree.keypoints[:, :2]
            for index in np.nonzero(tree.keypoints[:, 2] > 0)[0]:
                errors[index].append(float(np.hypot(*gap[index])))
    return {
        name: float(np.median(values))
        for name, values in zip(KEYPOINT_NAMES, errors, strict=True)
        if values
    }


def _iou(box: Float, boxes: Float) -> Float:
    """(N,) overlap of one xyxy box with (N, 4)."""
    low, high = np.maximum(box[:2], boxes[:, :2]), np.minimum(box[2:], boxes[:, 2:])
    shared = np.clip(high - low, 0, None).prod(1)
    areas = (boxes[:, 2:] - boxes[:, :2]).prod(1) + (box[2:] - box[:2]).prod()
    return np.asarray(shared / np.maximum(areas - shared, 1e-9))
