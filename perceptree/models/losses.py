"""The five losses of Mask R-CNN with keypoints (He et al. 2017), each a float32 scalar."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from perceptree.models.boxes import encode_boxes
from perceptree.models.heads import BOX_WEIGHTS
from perceptree.models.matching import AnchorMatch
from perceptree.models.rpn import PROPOSAL_WEIGHTS, ProposalMaps
from perceptree.models.spec import HEAT_MAP_CELLS, MASK_CELLS
from perceptree.models.targets import PaddedBoxes

Share = Callable[[Tensor], Tensor]
"""Turns a count of this process into the mean count of all processes that train together.

A loss divided by it, averaged over the processes, is the loss of their joint batch.
"""


def alone(count: Tensor) -> Tensor:
    """The count of a process that trains by itself."""
    return count


def proposal_losses(
    maps: ProposalMaps,
    anchors: Tensor,
    match: AnchorMatch,
    trees: PaddedBoxes,
    share: Share = alone,
) -> dict[str, Tensor]:
    """Objectness and offsets over the sampled anchors, divided by their number."""
    logits = torch.cat(maps.logits, dim=1)
    deltas = torch.cat(maps.deltas, dim=1)
    sampled = match.positive | match.negative
    count = share(sampled.sum()).clamp(min=1)
    chosen = logits[sampled]
    truth = match.positive[sampled].to(chosen.dtype)
    objectness = functional.binary_cross_entropy_with_logits(chosen, truth, reduction="sum")
    image, anchor = match.positive.nonzero(as_tuple=True)
    boxes = trees.boxes[image, match.tree[image, anchor]]
    wanted = encode_boxes(boxes, anchors[anchor], PROPOSAL_WEIGHTS)
    shift = functional.l1_loss(deltas[image, anchor], wanted, reduction="sum")
    return {"objectness": objectness / count, "proposal_shift": shift / count}


def box_losses(
    logits: Tensor,
    shifts: Tensor,
    boxes: Tensor,
    truth: Tensor,
    positive: Tensor,
    used: Tensor,
    beta: float = 0.0,
    share: Share = alone,
) -> dict[str, Tensor]:
    """Class and offsets over regions (R, ...); truth (R, 4) matters where positive.

    The offsets' loss is smooth L1 with ``beta``, plain L1 at 0.
    """
    count = share(used.sum()).clamp(min=1)
    label = (~positive).long()
    entropy = functional.cross_entropy(logits, label, reduction="none")
    wanted = encode_boxes(truth[positive], boxes[positive], BOX_WEIGHTS)
    shift = functional.smooth_l1_loss(shifts[positive], wanted, reduction="sum", beta=beta)
    return {"score": (entropy * used).sum() / count, "box_shift": shift / count}


def mask_targets(boxes: Tensor, masks: Tensor, tree: Tensor) -> Tensor:
    """The truth at each cell's centre: boxes (R, 4) px, masks (N, H, W) bool, tree (R,) rows.

    Returns (R, 28, 28) float32.
    """
    height, width = masks.shape[-2:]
    step = (torch.arange(MASK_CELLS, device=boxes.device) + 0.5) / MASK_CELLS
    size = boxes[:, 2:] - boxes[:, :2]
    x = boxes[:, 0:1] + step * size[:, 0:1]
    y = boxes[:, 1:2] + step * size[:, 1:2]
    column = x.long().clamp(0, width - 1)
    row = y.long().clamp(0, height - 1)
    return masks[tree[:, None, None], row[:, :, None], column[:, None, :]].float()


def mask_loss(logits: Tensor, wanted: Tensor, share: Share = alone) -> Tensor:
    """Mean binary cross-entropy of (R, 28, 28); 0 without regions."""
    total = functional.binary_cross_entropy_with_logits(logits, wanted, reduction="sum")
    cells = torch.tensor(wanted.numel(), device=wanted.device)
    return total / share(cells).clamp(min=1)


def keypoint_targets(boxes: Tensor, keypoints: Tensor) -> tuple[Tensor, Tensor]:
    """The cell of each keypoint: boxes (R, 4) px, keypoints (R, K, 3) px and flag.

    Returns the flat cell (R, K) int64 and (R, K) bool: labelled and inside the box. A keypoint
    on the right or lower edge belongs to the last cell.
    """
    size = (boxes[:, 2:] - boxes[:, :2]).clamp(min=1e-6)[:, None]
    position = (keypoints[..., :2] - boxes[:, None, :2]) / size
    inside = ((position >= 0.0) & (position <= 1.0)).all(dim=-1) & (keypoints[..., 2] > 0)
    cell = (position * HEAT_MAP_CELLS).long().clamp(0, HEAT_MAP_CELLS - 1)
    return cell[..., 1] * HEAT_MAP_CELLS + cell[..., 0], inside


def keypoint_loss(maps: Tensor, cells: Tensor, inside: Tensor, share: Share = alone) -> Tensor:
    """Cross-entropy over the cells of (R, K, S, S), mean over keypoints inside; else 0."""
    logits = maps.flatten(2)[inside]
    total = functional.cross_entropy(logits, cells[inside], reduction="sum")
    return total / share(inside.sum()).clamp(min=1)


def joined(parts: Sequence[Tensor], device: torch.device) -> Tensor:
    """One field of all images' trees, one after the other."""
    return torch.cat(list(parts)).to(device)
