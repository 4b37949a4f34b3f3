"""Operations on boxes: encoding, clipping, overlap and non-maximum suppression (NMS)."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torchvision.ops import batched_nms, nms

# Limit of the predicted log size ratio, so that exp() of an untrained network's output stays
# finite. The value is Detectron2's.
MAX_LOG_SCALE = math.log(1000.0 / 16.0)


def encode_boxes(boxes: Tensor, anchors: Tensor, weights: tuple[float, ...]) -> Tensor:
    """Encode boxes as offsets from anchors (Girshick et al. 2014, R-CNN, appendix C).

    Args:
        boxes: (..., 4) xyxy px.
        anchors: (..., 4) xyxy px.
        weights: Factors of the four offsets.

    Returns:
        (..., 4): shift of the centre in x and y over the anchor's size, and logarithms of the
        ratios of width and height, each times its weight.
    """
    size, centre = _size_centre(anchors)
    box_size, box_centre = _size_centre(boxes)
    shift = (box_centre - centre) / size
    log_scale = torch.log(box_size / size)
    return torch.cat((shift, log_scale), dim=-1) * shift.new_tensor(weights)


def decode_boxes(deltas: Tensor, anchors: Tensor, weights: tuple[float, ...]) -> Tensor:
    """Decode offsets (..., 4) from anchors (..., 4) to boxes (..., 4) xyxy px.

    The inverse of `encode_boxes`. Size ratios are limited to 1000 / 16.
    """
    size, centre = _size_centre(anchors)
    scaled = deltas / deltas.new_tensor(weights)
    middle = centre + scaled[..., :2] * size
    half = 0.5 * size * torch.exp(scaled[..., 2:].clamp(max=MAX_LOG_SCALE))
    return torch.cat((middle - half, middle + half), dim=-1)


def clip_boxes(boxes: Tensor, height: int, width: int) -> Tensor:
    """Clip boxes (..., 4) xyxy px to an image of `height` x `width` px."""
    ends = boxes.new_tensor([width, height, width, height])
    return torch.minimum(boxes.clamp(min=0.0), ends)


def enlarge_boxes(boxes: Tensor, scale: float) -> Tensor:
    """Scale boxes (..., 4) xyxy px about their centres; the result may exceed the image."""
    size, centre = _size_centre(boxes)
    half = 0.5 * scale * size
    return torch.cat((centre - half, centre + half), dim=-1)


def pairwise_iou(first: Tensor, second: Tensor) -> Tensor:
    """Intersection over union of each pair of boxes.

    Args:
        first: (..., N, 4) xyxy px.
        second: (..., M, 4) xyxy px.

    Returns:
        (..., N, M), 0 to 1; 0 where a box is empty.
    """
    overlap = _overlap(first, second)
    union = _area(first)[..., :, None] + _area(second)[..., None, :] - overlap
    return torch.where(overlap > 0.0, overlap / union, torch.zeros_like(overlap))


def pairwise_share_within(boxes: Tensor, regions: Tensor) -> Tensor:
    """Share of each box's own area that lies in each region.

    Args:
        boxes: (..., N, 4) xyxy px.
        regions: (..., M, 4) xyxy px.

    Returns:
        (..., N, M), 0 to 1; 0 where a box is empty.
    """
    overlap = _overlap(boxes, regions)
    return torch.where(overlap > 0.0, overlap / _area(boxes)[..., :, None], 0.0)


def nms_keep_mask(boxes: Tensor, scores: Tensor, valid: Tensor, iou: float) -> Tensor:
    """Greedy non-maximum suppression of one image's boxes, as a mask.

    Args:
        boxes: (N, 4) xyxy px.
        scores: (N,).
        valid: (N,) bool; invalid boxes are not kept and suppress no others.
        iou: A box is removed if its overlap with a kept box of higher score exceeds this.

    Returns:
        (N,) bool, true for the kept boxes.
    """
    lowest = torch.finfo(scores.dtype).min
    ranked = torch.where(valid, scores, torch.full_like(scores, lowest))
    kept = nms(torch.where(valid[:, None], boxes, torch.zeros_like(boxes)), ranked, iou)
    return (torch.zeros_like(scores).index_fill(0, kept, 1.0) > 0.0) & valid


def joint_nms_keep_mask(boxes: Tensor, scores: Tensor, valid: Tensor, iou: float) -> Tensor:
    """Do as `nms_keep_mask` for the boxes of a batch, in one call for all images.

    On a GPU each call waits for its result; one call waits only once.

    Args:
        boxes: (B, N, 4) xyxy px.
        scores: (B, N).
        valid: (B, N) bool.
        iou: Overlap above which a box is removed.

    Returns:
        (B, N) bool, true for the kept boxes.
    """
    lowest = torch.finfo(scores.dtype).min
    ranked = torch.where(valid, scores, torch.full_like(scores, lowest)).flatten()
    known = torch.where(valid[..., None], boxes, torch.zeros_like(boxes)).flatten(0, 1)
    images = torch.arange(len(boxes), device=boxes.device).repeat_interleave(boxes.shape[1])
    kept = torch.zeros_like(valid.flatten())
    kept[batched_nms(known, ranked, images, iou)] = True
    return kept.view_as(valid) & valid


def nms_top_k(
    boxes: Tensor, scores: Tensor, valid: Tensor, iou: float, count: int
) -> tuple[Tensor, Tensor]:
    """Greedy non-maximum suppression of one image with a fixed number of results.

    Args:
        boxes: As for `nms_keep_mask`, and so are `scores`, `valid` and `iou`.
        scores: (N,).
        valid: (N,) bool.
        iou: Overlap above which a box is removed.
        count: Number of results, at most N.

    Returns:
        Rows of the kept boxes, (count,) int64 by descending score, and (count,) bool, false for
        the padding at the end.
    """
    kept = nms_keep_mask(boxes, scores, valid, iou)
    lowest = torch.finfo(scores.dtype).min
    ranked = torch.where(kept, scores, torch.full_like(scores, lowest))
    order = torch.topk(ranked, count).indices
    return order, kept[order]


def vote_boxes(kept: Tensor, boxes: Tensor, scores: Tensor, iou: float) -> Tensor:
    """Average each kept box over the boxes that it suppresses (Gidaris and Komodakis 2015).

    The weights are the scores, times how far the overlap with the kept box exceeds `iou`. So the
    kept box counts most among those of its score.

    Args:
        kept: (K, 4) xyxy px, some of `boxes`.
        boxes: (N, 4) xyxy px, all that non-maximum suppression chose from.
        scores: (N,), 0 for those that do not count.
        iou: Overlap above which a box is suppressed.

    Returns:
        (K, 4) xyxy px. A box without weight stays as it is.
    """
    weights = scores * (pairwise_iou(kept, boxes) - iou).clamp(min=0.0)
    total = weights.sum(dim=1, keepdim=True)
    # No matrix multiplication: quantisation would round its coordinates.
    mean = (weights[..., None] * boxes).sum(dim=1) / torch.where(total > 0.0, total, 1.0)
    return torch.where(total > 0.0, mean, kept)


def _size_centre(boxes: Tensor) -> tuple[Tensor, Tensor]:
    size = boxes[..., 2:] - boxes[..., :2]
    return size, boxes[..., :2] + 0.5 * size


def _overlap(first: Tensor, second: Tensor) -> Tensor:
    """(..., N, M) common area of each pair of (..., N, 4) and (..., M, 4) boxes."""
    low = torch.maximum(first[..., :, None, :2], second[..., None, :, :2])
    high = torch.minimum(first[..., :, None, 2:], second[..., None, :, 2:])
    return (high - low).clamp(min=0.0).prod(dim=-1)


def _area(boxes: Tensor) -> Tensor:
    return (boxes[..., 2:] - boxes[..., :2]).prod(dim=-1)
