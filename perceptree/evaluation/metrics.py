"""How good a detector is in a few numbers, as training and export ask for them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from perceptree.data import FrameStore
from perceptree.errors import DatasetError
from perceptree.evaluation.errors_px import PixelErrors, Spread, measure_errors
from perceptree.evaluation.matching import Matches, match_trees
from perceptree.evaluation.precision import Precision, Scorer
from perceptree.evaluation.predictions import FramePrediction, Predict, predict_frames
from perceptree.keypoints import KEYPOINT_NAMES

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Metrics:
    """COCO AP and AP50 in percent, and what they were taken on; None without branch or labels.

    ``keypoint_error_px`` is the median distance of each keypoint from the truth, in source px,
    and ``diameter_error_px`` the mean by which the distance of the two diameter keypoints is off:
    of trees matched at box IoU 0.5 with a score of at least 0.5, of all of which ``recall`` is
    the share. ``precision`` is the share of trees among what has such a score.
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
        """JSON-ready values."""
        return dataclasses.asdict(self)


@dataclass(frozen=True, eq=False)
class Measured:
    """What a detector said of all frames, and what follows from it."""

    store: FrameStore
    predictions: list[FramePrediction]
    scorer: Scorer
    matches: Matches
    errors: PixelErrors | None

    def metrics(self) -> Metrics:
        """The few numbers."""
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
            name: Spread.of(self.errors.of(place, "distance"))
            for place, name in enumerate(KEYPOINT_NAMES)
        }
        return {name: spread.median for name, spread in spreads.items() if spread is not None}


def evaluate(
    predict: Predict,
    store: FrameStore,
    batch: int = 1,
    progress: Progress = lambda frames: None,
) -> Metrics:
    """Average precision and pixel errors of ``predict`` over all frames of ``store``.

    ``progress`` gets the number of frames done since its last call. Raises DatasetError where
    ``store`` has no labelled tree: then precision means nothing.
    """
    return measure(predict, store, batch, progress).metrics()


def measure(
    predict: Predict, store: FrameStore, batch: int = 1, progress: Progress = lambda frames: None
) -> Measured:
    """As ``evaluate``, but everything that it rests on. Raises DatasetError likewise."""
    if store.trees == 0:
        raise DatasetError(f"{len(store)} frames without a labelled tree: expected some trees")
    predictions = []
    for prediction in predict_frames(predict, store, batch):
        predictions.append(prediction)
        progress(1)
    matches = match_trees(store.frames, predictions)
    return Measured(
        store,
        predictions,
        Scorer(store.frames, predictions),
        matches,
        measure_errors(store.frames, predictions, matches.found),
    )
