"""Overlaps of masks and keypoints of trees and their detections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pycocotools import mask as coco_mask

from basetree.arrays import Float
from calib import encode_rle
from perceptree.data import FrameRecord
from perceptree.evaluation.coco_matching import OKS_SIGMAS
from perceptree.evaluation.matching import Pair
from perceptree.evaluation.predictions import FramePrediction


def mask_ious(
    frames: Sequence[FrameRecord],
    predictions: Sequence[FramePrediction],
    pairs: Sequence[Pair],
) -> Float | None:
    """IoU of the masks of P pairs.

    Returns:
        (P,) overlaps, NaN where the label has no mask; None if the model has no masks.
    """
    masks = [each.masks for each in predictions if each.masks is not None]
    if len(masks) < len(predictions):
        return None
    overlaps = np.full(len(pairs), np.nan)
    for number, (frame, tree, row, _) in enumerate(pairs):
        record = frames[frame]
        if record.trees[tree].segmentation:
            label = encode_rle(record.mask(record.trees[tree]))
            overlaps[number] = coco_mask.iou([masks[frame][row]], [label], [0])[0, 0]
    return overlaps


def keypoint_similarities(
    frames: Sequence[FrameRecord],
    predictions: Sequence[FramePrediction],
    pairs: Sequence[Pair],
) -> Float | None:
    """COCO's object keypoint similarity (OKS) of P pairs.

    The mean of exp(-d² / (8 σ² A)) over the labelled keypoints, for their distances d, `OKS_SIGMAS`
    and the tree's area A: of its mask, or of its box if it has none.

    Returns:
        (P,) similarities, NaN where no keypoint is labelled; None if the model has no keypoints.
    """
    keypoints = [each.keypoints for each in predictions if each.keypoints is not None]
    if len(keypoints) < len(predictions):
        return None
    similarities = np.full(len(pairs), np.nan)
    for number, (frame, index, row, _) in enumerate(pairs):
        record, tree = frames[frame], frames[frame].trees[index]
        labelled = tree.keypoints[:, 2] > 0
        if labelled.any():
            area_px2 = np.prod(tree.box_px[2:] - tree.box_px[:2])
            if tree.segmentation:
                area_px2 = record.mask(tree).sum()
            off_px = keypoints[frame][row, :, :2] - tree.keypoints[:, :2]
            squares = np.vecdot(off_px, off_px) / (8 * np.square(OKS_SIGMAS) * max(area_px2, 1.0))
            similarities[number] = np.exp(-squares)[labelled].mean()
    return similarities
