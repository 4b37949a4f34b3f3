"""Find trees that were detected twice, by their masks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from basetree.arrays import Bool, Float, Float32
from edgetree.detections import TreeDetections

_INSIDE = 0.5


def distinct_trees(boxes: Float, masks: Float, max_overlap: float) -> Bool:
    """Which of N trees are not the same as a tree before them.

    The boxes of two detections of one stem can differ much, as those of its lower half and of the
    whole, so that suppression by boxes keeps both. Their masks still cover the same pixels. Two
    masks overlap by their common area, as a share of the smaller one's.

    Args:
        boxes: (N, 4) x0, y0, x1, y1, by descending score.
        masks: (N, S, S) probabilities on a grid over each box.
        max_overlap: a tree is dropped if its mask overlaps that of a kept one by more than this.

    Returns:
        (N,) true for the trees to keep.
    """
    count, size = len(boxes), masks.shape[-1]
    keep = np.ones(count, np.bool_)
    first, second = np.triu_indices(count, 1)
    lower = np.maximum(boxes[first, :2], boxes[second, :2])
    upper = np.minimum(boxes[first, 2:], boxes[second, 2:])
    touch = (upper > lower).all(1)
    first, second = first[touch], second[touch]
    if not len(first):
        return keep
    inside = masks > _INSIDE
    cell = (boxes[:, 2:] - boxes[:, :2]) / size
    area = inside.sum((1, 2)) * cell.prod(1)
    swap = area[first] < area[second]
    small, large = np.where(swap, first, second), np.where(swap, second, first)
    # The larger mask at the cells of the smaller one.
    centre = np.arange(size) + 0.5
    x = boxes[small, 0, None] + centre * cell[small, 0, None]
    y = boxes[small, 1, None] + centre * cell[small, 1, None]
    column = np.floor((x - boxes[large, 0, None]) / cell[large, 0, None])
    row = np.floor((y - boxes[large, 1, None]) / cell[large, 1, None])
    within = ((row >= 0) & (row < size))[:, :, None] & ((column >= 0) & (column < size))[:, None]
    row, column = (np.clip(each, 0, size - 1).astype(np.intp) for each in (row, column))
    there = inside[large[:, None, None], row[:, :, None], column[:, None]] & within
    common = (inside[small] & there).sum((1, 2))
    overlap = common / np.maximum(inside[small].sum((1, 2)), 1)
    for one, other in zip(first[overlap > max_overlap], second[overlap > max_overlap], strict=True):
        if keep[one]:
            keep[other] = False
    return keep


def joined(first: TreeDetections, second: TreeDetections, max_overlap: float) -> TreeDetections:
    """The trees of two detections in one image, each once, by descending score.

    Args:
        first: Trees of one model; whether the image is unlike its training is taken from them.
        second: Trees of the same model.
        max_overlap: As for `distinct_trees`. Without masks only `first` is taken.
    """
    if first.masks is None or second.masks is None:
        return first
    trees = replace(
        first,
        boxes_px=np.concatenate([first.boxes_px, second.boxes_px]),
        scores=np.concatenate([first.scores, second.scores]),
        masks=np.concatenate([first.masks, second.masks]),
        keypoints_px=_both(first.keypoints_px, second.keypoints_px),
        keypoint_stds_px=_both(first.keypoint_stds_px, second.keypoint_stds_px),
    )
    trees = trees.select(np.argsort(-trees.scores, kind="stable"))
    assert trees.masks is not None
    return trees.select(distinct_trees(trees.boxes_px, trees.masks, max_overlap))


def _both(first: Float32 | None, second: Float32 | None) -> Float32 | None:
    return None if first is None or second is None else np.concatenate([first, second])
