"""Which detection is which tree of the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Match", "box_iou", "match_boxes"]


class Match(NamedTuple):
    """One detection paired with one true tree, by their positions in the two lists."""

    detection: int
    truth: int
    iou: float


def box_iou(first_px: NDArray[np.floating], second_px: NDArray[np.floating]) -> NDArray[np.float64]:
    """Intersection over union of every pair of boxes.

    Args:
        first_px: (N, 4) x0, y0, x1, y1.
        second_px: (M, 4) likewise.

    Returns:
        (N, M) in [0, 1]; 0 where a pair covers no area at all.
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
    """Area between two corners (..., 2); 0 where they are in the wrong order."""
    sides: NDArray[np.float64] = np.clip(high - low, 0.0, None)
    return sides[..., 0] * sides[..., 1]


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
