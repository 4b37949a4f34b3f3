"""Which anchors and regions are trained on which tree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from perceptree.errors import SettingsError
from perceptree.models.boxes import pairwise_iou
from perceptree.models.targets import PaddedBoxes


@dataclass(frozen=True)
class SampleSettings:
    """What a training step learns from: how anchors and regions are chosen in each image.

    More proposals than in deployment make for harder and more varied regions. ``box_beta`` is
    where the smooth L1 loss of the box offsets turns from a parabola into a line (Girshick 2015);
    0 is plain L1.
    """

    proposals_per_level: int = 200
    proposals: int = 200
    anchors: int = 128
    anchor_positive_share: float = 0.5
    anchor_positive_iou: float = 0.5
    anchor_negative_iou: float = 0.3
    regions: int = 64
    region_positive_share: float = 0.375
    region_positive_iou: float = 0.5
    box_beta: float = 0.0

    def __post_init__(self) -> None:
        for name in ("proposals_per_level", "proposals", "anchors", "regions"):
            if getattr(self, name) < 1:
                raise SettingsError(f"{name} is {getattr(self, name)}: expected at least 1")
        for name in (
            "anchor_positive_share",
            "anchor_positive_iou",
            "region_positive_share",
            "region_positive_iou",
        ):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise SettingsError(f"{name} is {getattr(self, name)}: expected over 0, at most 1")
        if not 0.0 <= self.anchor_negative_iou <= self.anchor_positive_iou:
            raise SettingsError(
                f"anchor_negative_iou is {self.anchor_negative_iou}: expected 0 to "
                f"anchor_positive_iou ({self.anchor_positive_iou})"
            )
        if self.box_beta < 0.0:
            raise SettingsError(f"box_beta is {self.box_beta}: expected at least 0")


PAPER_SAMPLING = SampleSettings(
    proposals_per_level=2000,
    proposals=1500,
    anchors=256,
    anchor_positive_iou=0.7,
    regions=256,
    region_positive_share=0.25,
    box_beta=0.5,
)
"""Detectron2's keypoint configuration with the 256 regions of the paper's published script."""

Draw = Callable[[tuple[int, int], torch.device], Tensor]
"""Gives uniform random numbers (B, N), 0 to 1, a row for each image of the batch."""


def draw_anew(shape: tuple[int, int], device: torch.device) -> Tensor:
    """Random numbers of torch's own generator."""
    return torch.rand(shape, device=device)


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


def match_anchors(
    anchors: Tensor, trees: PaddedBoxes, settings: SampleSettings, draw: Draw = draw_anew
) -> AnchorMatch:
    """Sample anchors (A, 4) for objectness: a share of positives, where there are enough.

    An anchor is positive from ``anchor_positive_iou`` on, or when it is the best there is for a
    tree; otherwise negative below ``anchor_negative_iou``.
    """
    iou = pairwise_iou(trees.boxes, anchors.expand(len(trees.boxes), -1, -1))
    best, tree = iou.max(dim=1)
    best_of_tree = iou.max(dim=2, keepdim=True).values
    rescued = ((iou == best_of_tree) & (best_of_tree > 0.0)).any(dim=1)
    # A rescued anchor belongs to the tree that it overlaps most.
    positive = (best >= settings.anchor_positive_iou) | rescued
    negative = (best < settings.anchor_negative_iou) & ~positive
    positives = int(settings.anchors * settings.anchor_positive_share)
    positive = _sample(positive, torch.full_like(tree[:, :1], positives), positives, draw)
    room = settings.anchors - positive.sum(dim=1, keepdim=True)
    return AnchorMatch(positive, _sample(negative, room, settings.anchors, draw), tree)


def sample_regions(
    boxes: Tensor,
    valid: Tensor,
    trees: PaddedBoxes,
    settings: SampleSettings,
    draw: Draw = draw_anew,
) -> RegionSample:
    """Choose regions from proposals (B, P, 4) and the true boxes, at random within a share."""
    # The trees come last: how many columns they take differs from batch to batch, and an image's
    # random numbers must not depend on the images beside it.
    boxes = torch.cat((boxes, trees.boxes), dim=1)
    valid = torch.cat((valid, trees.valid), dim=1)
    best, tree = pairwise_iou(trees.boxes, boxes).max(dim=1)
    positive = valid & (best >= settings.region_positive_iou)
    positives = int(settings.regions * settings.region_positive_share)
    most = torch.full_like(tree[:, :1], positives)
    chosen = _sample(positive, most, min(positives, boxes.shape[1]), draw)
    # Rank: chosen positives, then negatives in random order, then what must not be used.
    shuffled = draw((best.shape[0], best.shape[1]), best.device)
    rank = shuffled + (valid & ~positive).float() + 2.0 * chosen
    order = torch.topk(rank, min(settings.regions, rank.shape[1]), dim=1).indices
    return RegionSample(
        torch.gather(boxes, 1, order[..., None].expand(-1, -1, 4)),
        torch.gather(chosen, 1, order),
        torch.gather(chosen | (valid & ~positive), 1, order),
        torch.gather(tree, 1, order),
    )


def _sample(candidates: Tensor, count: Tensor, most: int, draw: Draw) -> Tensor:
    """A random subset of (B, N) candidates with at most count (B, 1) <= most per row."""
    shape = (candidates.shape[0], candidates.shape[1])
    keys = torch.where(candidates, draw(shape, candidates.device), -1.0)
    values, order = torch.topk(keys, min(most, keys.shape[1]), dim=1)
    within = torch.arange(order.shape[1], device=order.device) < count
    picked = (values >= 0.0) & within
    return torch.zeros_like(candidates).scatter(1, order, picked)
