"""Assign anchors and regions to trees, and sample those that a training step uses."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from perceptree.models.boxes import pairwise_iou, pairwise_share_within
from perceptree.models.targets import PaddedBoxes
from perceptree.settings.sampling import SampleSettings

# Share of a box's own area in an ignored region from which on it is not background.
_IGNORED_SHARE = 0.5

RandomDraw = Callable[[tuple[int, int], torch.device], Tensor]
"""Returns uniform random numbers (B, N) from 0 to 1, one row per image of the batch."""


def uniform_draw(shape: tuple[int, int], device: torch.device) -> Tensor:
    """Draw from torch's default generator."""
    return torch.rand(shape, device=device)


class AnchorMatch(NamedTuple):
    """The sampled anchors of a batch."""

    positive: Tensor
    """(B, A) bool, sampled anchors on a tree."""
    negative: Tensor
    """(B, A) bool, sampled anchors on background."""
    tree: Tensor
    """(B, A) int64, the tree of the image with the highest overlap."""


class RegionSample(NamedTuple):
    """The regions of a batch that the heads are trained on, R per image."""

    boxes: Tensor
    """(B, R, 4) xyxy px."""
    positive: Tensor
    """(B, R) bool; the positive regions of an image come first."""
    used: Tensor
    """(B, R) bool; false for padding."""
    tree: Tensor
    """(B, R) int64, the tree of the image with the highest overlap."""


def match_anchors(
    anchors: Tensor, trees: PaddedBoxes, settings: SampleSettings, draw: RandomDraw = uniform_draw
) -> AnchorMatch:
    """Sample anchors for the objectness loss (Ren et al. 2015).

    An anchor is positive if its overlap with a tree is at least `anchor_positive_iou` or the
    highest of all anchors with that tree. Otherwise it is negative if its highest overlap is below
    `anchor_negative_iou` and it is not on an ignored region.

    Args:
        anchors: (A, 4) xyxy px.
        trees: True boxes and ignored regions of the batch.
        settings: Thresholds and numbers.
        draw: Source of random numbers.
    """
    iou = pairwise_iou(trees.boxes, anchors.expand(len(trees.boxes), -1, -1))
    best, tree = iou.max(dim=1)
    best_of_tree = iou.max(dim=2, keepdim=True).values
    is_best_of_a_tree = ((iou == best_of_tree) & (best_of_tree > 0.0)).any(dim=1)
    # Such an anchor is still assigned to the tree that it overlaps most.
    positive = (best >= settings.anchor_positive_iou) | is_best_of_a_tree
    negative = (best < settings.anchor_negative_iou) & ~positive
    if trees.ignored is not None:
        negative &= ~_on_ignored(anchors, trees.ignored, settings.anchor_negative_iou)
    positives = int(settings.anchors * settings.anchor_positive_share)
    positive = _sample(positive, torch.full_like(tree[:, :1], positives), positives, draw)
    room = settings.anchors - positive.sum(dim=1, keepdim=True)
    return AnchorMatch(positive, _sample(negative, room, settings.anchors, draw), tree)


def sample_regions(
    boxes: Tensor,
    valid: Tensor,
    trees: PaddedBoxes,
    settings: SampleSettings,
    draw: RandomDraw = uniform_draw,
) -> RegionSample:
    """Sample regions for the heads from the proposals and the true boxes (Girshick 2015).

    Proposals on an ignored region are left out, unless they are positive.

    Args:
        boxes: (B, P, 4) proposals, xyxy px.
        valid: (B, P) bool, false for padding.
        trees: True boxes and ignored regions of the batch.
        settings: Threshold and numbers.
        draw: Source of random numbers.
    """
    # The true boxes come last: their number of columns differs between batches, and an image's
    # random numbers must not depend on the other images of its batch.
    boxes = torch.cat((boxes, trees.boxes), dim=1)
    valid = torch.cat((valid, trees.valid), dim=1)
    best, tree = pairwise_iou(trees.boxes, boxes).max(dim=1)
    positive = valid & (best >= settings.region_positive_iou)
    negative = valid & ~positive
    if trees.ignored is not None:
        negative &= ~_on_ignored(boxes, trees.ignored, settings.region_positive_iou)
    positives = int(settings.regions * settings.region_positive_share)
    most = torch.full_like(tree[:, :1], positives)
    chosen = _sample(positive, most, min(positives, boxes.shape[1]), draw)
    # Order: chosen positives, then negatives in random order, then unused regions.
    shuffled = draw((best.shape[0], best.shape[1]), best.device)
    rank = shuffled + negative.float() + 2.0 * chosen
    order = torch.topk(rank, min(settings.regions, rank.shape[1]), dim=1).indices
    return RegionSample(
        torch.gather(boxes, 1, order[..., None].expand(-1, -1, 4)),
        torch.gather(chosen, 1, order),
        torch.gather(chosen | negative, 1, order),
        torch.gather(tree, 1, order),
    )


def _on_ignored(boxes: Tensor, ignored: Tensor, least_iou: float) -> Tensor:
    """Whether boxes (N, 4) or (B, N, 4) are on one of the (B, M, 4) ignored regions: (B, N).

    They are if half of their area lies in it, or their overlap with it is at least `least_iou`.
    """
    inside = pairwise_share_within(boxes, ignored) >= _IGNORED_SHARE
    return (inside | (pairwise_iou(boxes, ignored) >= least_iou)).any(-1)


def _sample(candidates: Tensor, count: Tensor, most: int, draw: RandomDraw) -> Tensor:
    """Choose at most `count` (B, 1), itself at most `most`, of (B, N) candidates per row."""
    shape = (candidates.shape[0], candidates.shape[1])
    keys = torch.where(candidates, draw(shape, candidates.device), -1.0)
    values, order = torch.topk(keys, min(most, keys.shape[1]), dim=1)
    within = torch.arange(order.shape[1], device=order.device) < count
    picked = (values >= 0.0) & within
    return torch.zeros_like(candidates).scatter(1, order, picked)
