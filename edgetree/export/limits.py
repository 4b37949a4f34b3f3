"""Limits on the differences between a file and its model, for each precision."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final


@dataclass(frozen=True)
class ParityLimits:
    """Largest allowed differences between a file and its model. None means no limit.

    Attributes:
        box_px: Largest difference of a box coordinate, in pixels of the input.
        keypoint_px: Largest difference of a keypoint coordinate, in pixels of the input.
        keypoint_std_px: Largest difference of a keypoint's standard deviation, likewise.
        score: Largest difference of a score.
        keypoint_score: Largest difference of a keypoint's score.
        keypoint_ties: Largest share of keypoints that may lie elsewhere with the same score, see
            `FrameParity.keypoint_ties`.
        mask_probability: Largest difference of a mask's probability in one cell.
        mask_iou: Smallest intersection over union of two masks.
        percentiles: Limits on percentiles over all matched trees, see
            `ParityReport.percentiles`; smallest values for `mask_iou`, largest for the others.
        match_iou: Intersection over union of boxes from which two detections are the same tree.
        matched: Smallest share of trees that both must find. For `float32` all trees count,
            otherwise those with a score of 0.5 or more.
        ap_loss: Largest loss of average precision, in percentage points.
    """

    box_px: float | None = None
    keypoint_px: float | None = None
    keypoint_std_px: float | None = None
    score: float | None = None
    keypoint_score: float | None = None
    keypoint_ties: float = 0.0
    mask_probability: float | None = None
    mask_iou: float | None = None
    percentiles: Mapping[str, float] = field(default_factory=dict)
    match_iou: float = 0.5
    matched: float = 1.0
    ap_loss: float | None = None


# docs/explanation/gate.md says what exports gave when the percentiles' limits were chosen.
_LIMITS: Final = {
    "float32": ParityLimits(
        box_px=0.5,
        keypoint_px=0.5,
        keypoint_std_px=0.5,
        score=1e-3,
        keypoint_score=1e-3,
        keypoint_ties=5e-3,
        mask_probability=2e-3,
        mask_iou=0.98,
    ),
    "float16": ParityLimits(
        percentiles={
            "score_median": 0.002,
            "keypoint_score_median": 0.002,
            "keypoint_shift_median": 0.005,
            "keypoint_shift_p90": 0.02,
            "keypoint_std_median": 0.005,
            "keypoint_std_p90": 0.02,
            "mask_probability_median": 0.002,
            "mask_iou_median": 0.98,
            "mask_iou_p10": 0.95,
        },
        match_iou=0.8,
        matched=0.99,
        ap_loss=0.2,
    ),
    "int8": ParityLimits(
        percentiles={
            "score_median": 0.05,
            "keypoint_score_median": 0.05,
            "keypoint_shift_median": 0.04,
            "keypoint_shift_p90": 0.15,
            "keypoint_std_median": 0.04,
            "keypoint_std_p90": 0.15,
            "mask_probability_median": 0.04,
            "mask_iou_median": 0.85,
            "mask_iou_p10": 0.6,
        },
        match_iou=0.8,
        matched=0.95,
        ap_loss=1.0,
    ),
}
UNTRAINED_LIMITS: Final = ParityLimits(matched=0.0)
"""For random weights in `float16` and `int8`: only the validity of the outputs is checked."""


def limits_of(precision: str, *, trained: bool = True) -> ParityLimits:
    """The limits for a precision.

    Args:
        precision: `float32`, `float16` or `int8`.
        trained: Whether the network is trained. The scores and boxes of an untrained one change
            too much by rounding, so there is no limit for it except in `float32`.
    """
    limits = _LIMITS[precision]
    return limits if trained or precision == "float32" else UNTRAINED_LIMITS
