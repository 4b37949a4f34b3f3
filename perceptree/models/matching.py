"""Which anchors and regions are trained on which tree."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from perceptree.models.boxes import pairwise_iou
from perceptree.models.targets import PaddedBoxes

ANCHOR_POSITIVE_IOU = 0.5
ANCHOR_NEGATIVE_IOU = 0.3
ANCHORS_PER_IMAGE = 128
ANCHOR_POSITIVES = 64
REGION_POSITIVE_IOU = 0.5
REGIONS_PER_IMAGE = 64
REGION_POSITIVES = 24


class AnchorMatch(NamedTuple):
    """The sampled anchors of a batch."""

    positive: Tensor
    """(B, A) bool."""
    negative: Tensor
    """(B, A) bool."""
    tree: Tensor
    """(B, A) int64, the row of the best-overlapping tree."""


class RegionSample(NamedTuple):
    """The regions of a batch that the heads train on, the same number R in each image."""

    boxes: Tensor
    """(B, R, 4) xyxy px."""
    positive: Tensor
    """(B, R) bool; an image's positives come first."""
    used: Tensor
    """(B, R) bool; false for filling."""
    tree: Tensor
    """(B, R) int64, the row of the best-overlapping tree."""


def match_anchors(anchors: Tensor, trees: PaddedBoxes) -> AnchorMatch:
    """Sample anchors (A, 4) for objectness: half positive where there are enough.

    An anchor is positive over ``ANCHOR_POSITIVE_IOU``, or when it is the best there is for a
    tree; negative below ``ANCHOR_NEGATIVE_IOU`` otherwise.
    """
    iou = pairwise_iou(trees.boxes, anchors.expand(len(trees.boxes), -1, -1))
    best, tree = iou.max(dim=1)
    best_of_tree = iou.max(dim=2, keepdim=True).values
    rescued = ((iou == best_of_tree) & (best_of_tree > 0.0)).any(dim=1)
    # A rescued anchor belongs to the tree that it overlaps most.
    positive = (best >= ANCHOR_POSITIVE_IOU) | rescued
    negative = (best < ANCHOR_NEGATIVE_IOU) & ~positive
    positive = _sample(positive, torch.full_like(tree[:, :1], ANCHOR_POSITIVES), ANCHOR_POSITIVES)
    room = ANCHORS_PER_IMAGE - positive.sum(dim=1, keepdim=True)
    return AnchorMatch(positive, _sample(negative, room, ANCHORS_PER_IMAGE), tree)


def sample_regions(boxes: Tensor, valid: Tensor, trees: PaddedBoxes) -> RegionSample:
    """Choose regions from proposals (B, P, 4) and the true boxes, at random within a share."""
    boxes = torch.cat((trees.boxes, boxes), dim=1)
    valid = torch.cat((trees.valid, valid), dim=1)
    best, tree = pairwise_iou(trees.boxes, boxes).max(dim=1)
    positive = valid & (best >= REGION_POSITIVE_IOU)
    most = torch.full_like(tree[:, :1], REGION_POSITIVES)
    chosen = _sample(positive, most, min(REGION_POSITIVES, boxes.shape[1]))
    # Rank: chosen positives, then negatives in random order, then what must not be used.
    rank = torch.rand(best.shape, device=best.device) + (valid & ~positive).float() + 2.0 * chosen
    order = torch.topk(rank, min(REGIONS_PER_IMAGE, rank.shape[1]), dim=1).indices
    return RegionSample(
        torch.gather(boxes, 1, order[..., None].expand(-1, -1, 4)),
        torch.gather(chosen, 1, order),
        torch.gather(chosen | (valid & ~positive), 1, order),
        torch.gather(tree, 1, order),
    )


def _sample(candidates: Tensor, count: Tensor, most: int) -> Tensor:
    """A random subset of (B, N) candidates with at most count (B, 1) <= most per row."""
    keys = torch.where(candidates, torch.rand(candidates.shape, device=candidates.device), -1.0)
    values, order = torch.topk(keys, min(most, keys.shape[1]), dim=1)
    within = torch.arange(order.shape[1], device=order.device) < count
    picked = (values >= 0.0) & within
    return torch.zeros_like(candidates).scatter(1, order, picked)
