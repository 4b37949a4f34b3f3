"""Match detections with the ground truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib import box_iou


class Match(NamedTuple):
    """A matched pair: the indices of the detection and the true tree, and their IoU."""

    detection: int
    truth: int
    iou: float


def match_boxes(
    detected_px: NDArray[np.floating], true_px: NDArray[np.floating], min_iou: float = 0.5
) -> list[Match]:
    """Match detections with true boxes as in COCO's evaluation.

    In the given order, each detection is matched with the unmatched true box of largest
    intersection over union, if that is at least `min_iou`.

    Args:
        detected_px: (N, 4) x0, y0, x1, y1, by descending score.
        true_px: (M, 4) x0, y0, x1, y1, in any order.
        min_iou: Smallest intersection over union of a match.
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
