"""Summary metrics of a detector, used by training and export."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from basetree.counts import counted
from perceptree.data import FrameStore
from perceptree.errors import DatasetError
from perceptree.evaluation.errors_px import PixelErrors, Spread, measure_errors
from perceptree.evaluation.matching import Matches, match_trees
from perceptree.evaluation.precision import Precision, Scorer
from perceptree.evaluation.predictions import (
    Chances,
    FramePrediction,
    Predict,
    predict_frames,
)
from perceptree.keypoints import KEYPOINT_NAMES

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Metrics:
    """Summary metrics; None where the model has no such branch or the data no such labels.

    Recall, precision and the errors in px refer to detections with a score of at least 0.5, matched
    at a box IoU of at least 0.5.

    Attributes:
        frames: Number of frames.
        trees: Number of labelled trees.
        box_ap: COCO AP of boxes in percent.
        box_ap50: AP of boxes at IoU 0.50 in percent.
        mask_ap: COCO AP of masks in percent.
        mask_ap50: AP of masks at IoU 0.50 in percent.
        keypoint_ap: COCO AP of keypoints in percent.
        keypoint_ap50: AP of keypoints at OKS 0.50 in percent.
        keypoint_error_px: Median distance of each keypoint from the truth, in source px.
        diameter_error_px: Mean absolute error of the distance of the two diameter keypoints, in
            source px.
        recall: Share of the trees that were found, 0 to 1.
        precision: Share of the detections that are trees, 0 to 1.
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
    diameter_error_px: float | None = None
    recall: float | None = None
    precision: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return dataclasses.asdict(self)


@dataclass(frozen=True, eq=False)
class Measured:
    """Predictions of all frames and the results computed from them.

    Attributes:
        store: The frames.
        predictions: Prediction of each frame.
        scorer: Average precision.
        matches: Matched and unmatched trees and detections.
        errors: Errors in px, None if there are none.
    """

    store: FrameStore
    predictions: list[FramePrediction]
    scorer: Scorer
    matches: Matches
    errors: PixelErrors | None

    def metrics(self) -> Metrics:
        """Return the summary metrics."""
        none = Precision(0.0, 0.0, 0.0)
        boxes = self.scorer.precision("bbox") or none
        masks, keypoints = self.scorer.precision("segm"), self.scorer.precision("keypoints")
        width = None if self.errors is None else Spread.of(self.errors.width)
        return Metrics(
            frames=len(self.store),
            trees=self.store.trees,
            box_ap=boxes.ap,
            box_ap50=boxes.ap50,
            mask_ap=None if masks is None else masks.ap,
            mask_ap50=None if masks is None else masks.ap50,
            keypoint_ap=None if keypoints is None else keypoints.ap,
            keypoint_ap50=None if keypoints is None else keypoints.ap50,
            keypoint_error_px=self._keypoint_errors(),
            diameter_error_px=None if width is None else width.mean_abs,
            recall=self.matches.recall,
            precision=self.matches.precision,
        )

    def _keypoint_errors(self) -> dict[str, float]:
        if self.errors is None:
            return {}
        spreads = {
            name: Spread.of(self.errors.of(index, "distance"))
            for index, name in enumerate(KEYPOINT_NAMES)
        }
        return {name: spread.median for name, spread in spreads.items() if spread is not None}


def evaluate(
    predict: Predict,
    store: FrameStore,
    batch: int = 1,
    progress: Progress = lambda frames: None,
) -> Metrics:
    """Compute the metrics of a detector on all frames.

    Args:
        predict: The detector.
        store: Labelled frames.
        batch: Batch size.
        progress: Called with the number of frames done since its last call.

    Raises:
        DatasetError: If no tree is labelled.
    """
    return measure(predict, store, batch, progress).metrics()


def measure(
    predict: Predict,
    store: FrameStore,
    batch: int = 1,
    progress: Progress = lambda frames: None,
    chances: Chances | None = None,
) -> Measured:
    """Do as `evaluate`, but return all intermediate results.

    Args:
        predict: As for `evaluate`.
        store: As for `evaluate`.
        batch: As for `evaluate`.
        progress: As for `evaluate`.
        chances: By which the scores are multiplied, as for `predict_frames`.

    Raises:
        DatasetError: If no tree is labelled, or all are ignored.
    """
    check_trees(store)
    predictions = []
    for prediction in predict_frames(predict, store, batch, chances):
        predictions.append(prediction)
        progress(1)
    return measured_from(store, predictions)


def check_trees(store: FrameStore) -> None:
    """Raise DatasetError if no tree is labelled, or all are ignored."""
    if store.trees == 0:
        ignored = sum(len(frame.trees) for frame in store.frames)
        why = f"tree that counts ({ignored} are ignored)" if ignored else "labelled tree"
        raise DatasetError(f"{counted(len(store), 'frame')} without a {why}: expected at least one")


def measured_from(store: FrameStore, predictions: list[FramePrediction]) -> Measured:
    """Compute all results of the predictions of all frames.

    Args:
        store: Labelled frames, with at least one tree.
        predictions: Prediction of each frame.
    """
    matches = match_trees(store.frames, predictions)
    return Measured(
        store,
        predictions,
        Scorer(store.frames, predictions),
        matches,
        measure_errors(store.frames, predictions, matches.found),
    )
