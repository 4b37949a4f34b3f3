"""Which detection is which tree of the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib import box_iou

__all__ = ["Match", "match_boxes"]


class Match(NamedTuple):
    """One detection paired with one true tree, by their positions in the two lists."""

    detection: int
    truth: int
    iou: float


def match_boxes(
    detected_px: NDArray[np.floating], true_px: NDArray[np.floating], min_iou: float = 0.5
) -> list[Match]:
    """Pair detections with true boxes as COCO's evaluation does.

    In the given order, best score first, each detection takes the free true box that it overlaps
    most, if their intersection over union is at least `min_iou`.

    Args:
        detected_px: (N, 4) x0, y0, x1, y1, by falling score.
        true_px: (M, 4) likewise, in any order.
        min_iou: least overlap of a pair.
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
