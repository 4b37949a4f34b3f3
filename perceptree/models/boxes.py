"""Arithmetic on boxes: coding, overlap, clipping, suppression with fixed shapes."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torchvision.ops import nms

# A network that has not learned yet may ask for any growth; exp() stays finite below this.
MAX_LOG_SCALE = math.log(1000.0 / 16.0)


def encode_boxes(boxes: Tensor, anchors: Tensor, weights: tuple[float, ...]) -> Tensor:
    """Offsets from anchors to boxes, both (..., 4) xyxy px -> (..., 4) as (dx, dy, dw, dh).

    The parametrisation of Girshick et al., "Rich feature hierarchies" (2014), appendix C,
    times ``weights``.
    """
    size, centre = _size_centre(anchors)
    box_size, box_centre = _size_centre(boxes)
    shift = (box_centre - centre) / size
    growth = torch.log(box_size / size)
    return torch.cat((shift, growth), dim=-1) * shift.new_tensor(weights)


def decode_boxes(deltas: Tensor, anchors: Tensor, weights: tuple[float, ...]) -> Tensor:
    """The inverse of :func:`encode_boxes`; growth is capped at 1000/16."""
    size, centre = _size_centre(anchors)
    scaled = deltas / deltas.new_tensor(weights)
    middle = centre + scaled[..., :2] * size
    half = 0.5 * size * torch.exp(scaled[..., 2:].clamp(max=MAX_LOG_SCALE))
    return torch.cat((middle - half, middle + half), dim=-1)


def clip_boxes(boxes: Tensor, height: int, width: int) -> Tensor:
    """Cut (..., 4) xyxy px boxes at the borders of an image."""
    x = boxes[..., 0::2].clamp(0.0, float(width))
    y = boxes[..., 1::2].clamp(0.0, float(height))
    return torch.stack((x[..., 0], y[..., 0], x[..., 1], y[..., 1]), dim=-1)


def enlarge_boxes(boxes: Tensor, scale: float) -> Tensor:
    """Grow (..., 4) xyxy px boxes about their centres; they may leave the image."""
    size, centre = _size_centre(boxes)
    half = 0.5 * scale * size
    return torch.cat((centre - half, centre + half), dim=-1)


def pairwise_iou(first: Tensor, second: Tensor) -> Tensor:
    """Overlap of (..., N, 4) with (..., M, 4) xyxy px boxes -> (..., N, M); 0 for empty ones."""
    low = torch.maximum(first[..., :, None, :2], second[..., None, :, :2])
    high = torch.minimum(first[..., :, None, 2:], second[..., None, :, 2:])
    overlap = (high - low).clamp(min=0.0).prod(dim=-1)
    union = _area(first)[..., :, None] + _area(second)[..., None, :] - overlap
    return torch.where(overlap > 0.0, overlap / union, torch.zeros_like(overlap))


def survivors(boxes: Tensor, scores: Tensor, valid: Tensor, iou: float) -> Tensor:
    """Greedy suppression of one image: boxes (N, 4) xyxy px, scores (N,), valid (N,) bool.

    Returns (N,) bool. What is not valid neither survives nor suppresses.
    """
    lowest = torch.finfo(scores.dtype).min
    ranked = torch.where(valid, scores, torch.full_like(scores, lowest))
    kept = nms(torch.where(valid[:, None], boxes, torch.zeros_like(boxes)), ranked, iou)
    return (torch.zeros_like(scores).index_fill(0, kept, 1.0) > 0.0) & valid


def suppress(
    boxes: Tensor, scores: Tensor, valid: Tensor, iou: float, count: int
) -> tuple[Tensor, Tensor]:
    """Greedy suppression of one image with a fixed number of results.

    Takes what :func:`survivors` takes. Returns the rows kept, (count,) int64 by falling score,
    and (count,) bool that tells the real ones from the filling at the end.
    """
    alive = survivors(boxes, scores, valid, iou)
    lowest = torch.finfo(scores.dtype).min
    ranked = torch.where(alive, scores, torch.full_like(scores, lowest))
    order = torch.topk(ranked, count).indices
    return order, alive[order]


def _size_centre(boxes: Tensor) -> tuple[Tensor, Tensor]:
    size = boxes[..., 2:] - boxes[..., :2]
    return size, boxes[..., :2] + 0.5 * size


def _area(boxes: Tensor) -> Tensor:
    return (boxes[..., 2:] - boxes[..., :2]).prod(dim=-1)
