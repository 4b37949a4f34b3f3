"""Match detections with the ground truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Match", "box_iou", "match_boxes"]


class Match(NamedTuple):
    """A matched pair: the indices of the detection and the true tree, and their IoU."""

    detection: int
    truth: int
    iou: float


def box_iou(first_px: NDArray[np.floating], second_px: NDArray[np.floating]) -> NDArray[np.float64]:
    """Intersection over union of each pair of boxes.

    Args:
        first_px: (N, 4) x0, y0, x1, y1.
        second_px: (M, 4) x0, y0, x1, y1.

    Returns:
        (N, M) in [0, 1]; 0 if both boxes of a pair have no area.
    """
    first = np.asarray(first_px, dtype=np.float64).reshape(-1, 1, 4)
    second = np.asarray(second_px, dtype=np.float64).reshape(1, -1, 4)
    corners = (
        np.maximum(first[..., :2], second[..., :2]),
        np.minimum(first[..., 2:], second[..., 2:]),
    )
    shared = _area(*corners)
    union = _area(first[..., :2], first[..., 2:]) + _area(second[..., :2], second[..., 2:]) - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0.0)


def _area(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Area between two corners (..., 2); 0 if they are in the wrong order."""
    sides: NDArray[np.float64] = np.clip(high - low, 0.0, None)
    return sides[..., 0] * sides[..., 1]


def match_boxes(
    detected_px: NDArray[np.floating], true_px: NDArray[np.floating], min_iou: float = 0.5
) -> list[Match]:
    """Match detections with true boxes as in COCO's evaluation.

    In the given order, each detection is matched with the unmatched true box of largest
    intersection over union, if that is at least `min_iou`.

    Args:
        detected_px: (N, 4) x0, y0, x1, y1, by descending score.
        true_px: (M, 4) x0, y0, x1, y1, in any order.
        min_iou: smallest intersection over union of a match.
    """
    free = box_iou(detected_px, true_px)
    matches = []
    for detection in range(free.shape[0]):
        if free.shape[1] == 0:
            break
        truth = int(free[detection].argmax())
        iou = float(free[detection, truth])
        if iou >= min_iou:
            matches.append(Match(detection, truth, iou))
            free[:, truth] = -1.0
    return matches
