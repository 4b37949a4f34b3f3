"""The losses of Mask R-CNN with keypoints (He et al. 2017), each a float32 scalar."""

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

CountReducer = Callable[[Tensor], Tensor]
"""Returns the mean over all training processes of a count, given this process's count.

If every process divides its loss by that mean, the mean of the losses is the loss of the joint
batch.
"""


def local_count(count: Tensor) -> Tensor:
    """Return `count`: the mean count of a single training process."""
    return count


def proposal_losses(
    maps: ProposalMaps,
    anchors: Tensor,
    match: AnchorMatch,
    trees: PaddedBoxes,
    mean_count: CountReducer = local_count,
) -> dict[str, Tensor]:
    """Losses of the proposal network (Ren et al. 2015) over the sampled anchors.

    Args:
        maps: Output of the proposal network.
        anchors: (A, 4) xyxy px, all levels.
        match: The sampled anchors.
        trees: True boxes of the batch.
        mean_count: Mean of a count over the training processes.

    Returns:
        `objectness` (binary cross-entropy) and `proposal_shift` (L1 of the box offsets), each
        divided by the number of sampled anchors.
    """
    logits = torch.cat(maps.logits, dim=1)
    deltas = torch.cat(maps.deltas, dim=1)
    sampled = match.positive | match.negative
    count = mean_count(sampled.sum()).clamp(min=1)
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
    mean_count: CountReducer = local_count,
) -> dict[str, Tensor]:
    """Losses of the box head over regions.

    Args:
        logits: (R, 2) of tree and background.
        shifts: (R, 4) predicted box offsets.
        boxes: (R, 4) regions, xyxy px.
        truth: (R, 4) true boxes, xyxy px, used for positive regions only.
        positive: (R,) bool, regions on a tree.
        used: (R,) bool, false for padding.
        beta: Parameter of the smooth L1 loss (Girshick 2015) of the offsets; 0 is plain L1.
        mean_count: Mean of a count over the training processes.

    Returns:
        `score` (cross-entropy of the class) and `box_shift`, each divided by the number of
        used regions.
    """
    count = mean_count(used.sum()).clamp(min=1)
    label = (~positive).long()
    entropy = functional.cross_entropy(logits, label, reduction="none")
    wanted = encode_boxes(truth[positive], boxes[positive], BOX_WEIGHTS)
    shift = functional.smooth_l1_loss(shifts[positive], wanted, reduction="sum", beta=beta)
    return {"score": (entropy * used).sum() / count, "box_shift": shift / count}


def mask_targets(boxes: Tensor, masks: Tensor, tree: Tensor) -> Tensor:
    """Sample the true masks at the centre of each cell of the boxes.

    Args:
        boxes: (R, 4) xyxy px.
        masks: (N, H, W) bool, masks of all trees of the batch.
        tree: (R,) int64, the mask of each box.

    Returns:
        (R, 28, 28) float32, 0 or 1.
    """
    height, width = masks.shape[-2:]
    step = (torch.arange(MASK_CELLS, device=boxes.device) + 0.5) / MASK_CELLS
    size = boxes[:, 2:] - boxes[:, :2]
    x = boxes[:, 0:1] + step * size[:, 0:1]
    y = boxes[:, 1:2] + step * size[:, 1:2]
    column = x.long().clamp(0, width - 1)
    row = y.long().clamp(0, height - 1)
    return masks[tree[:, None, None], row[:, :, None], column[:, None, :]].float()


def mask_loss(logits: Tensor, wanted: Tensor, mean_count: CountReducer = local_count) -> Tensor:
    """Mean binary cross-entropy of `logits` and `wanted` (R, 28, 28); 0 without regions."""
    total = functional.binary_cross_entropy_with_logits(logits, wanted, reduction="sum")
    cells = torch.tensor(wanted.numel(), device=wanted.device)
    return total / mean_count(cells).clamp(min=1)


def keypoint_targets(boxes: Tensor, keypoints: Tensor) -> tuple[Tensor, Tensor]:
    """Find the heat map cell of each keypoint.

    A keypoint on the right or lower edge of its box belongs to the last cell.

    Args:
        boxes: (R, 4) xyxy px, the area that a region's heat maps cover.
        keypoints: (R, K, 3) x px, y px and flag (0 is unlabelled).

    Returns:
        (R, K) int64 index of the cell in the flattened map, and (R, K) bool, true for keypoints
        that are labelled and inside the box.
    """
    size = (boxes[:, 2:] - boxes[:, :2]).clamp(min=1e-6)[:, None]
    position = (keypoints[..., :2] - boxes[:, None, :2]) / size
    inside = ((position >= 0.0) & (position <= 1.0)).all(dim=-1) & (keypoints[..., 2] > 0)
    cell = (position * HEAT_MAP_CELLS).long().clamp(0, HEAT_MAP_CELLS - 1)
    return cell[..., 1] * HEAT_MAP_CELLS + cell[..., 0], inside


def keypoint_loss(
    maps: Tensor, cells: Tensor, inside: Tensor, mean_count: CountReducer = local_count
) -> Tensor:
    """Cross-entropy over the cells of each heat map, mean over the keypoints inside their box.

    Args:
        maps: (R, K, S, S) logits.
        cells: (R, K) int64, true cells.
        inside: (R, K) bool, keypoints to use.
        mean_count: Mean of a count over the training processes.

    Returns:
        The loss; 0 if no keypoint is inside.
    """
    logits = maps.flatten(2)[inside]
    total = functional.cross_entropy(logits, cells[inside], reduction="sum")
    return total / mean_count(inside.sum()).clamp(min=1)


def concatenate_on_device(parts: Sequence[Tensor], device: torch.device) -> Tensor:
    """Concatenate one target tensor of all images along the trees, and move it to a device."""
    return torch.cat(list(parts)).to(device)
