"""Pooling of regions from one or several pyramid levels, without scattering.

Two forms of the same aligned RoIAlign (He et al. 2017, with two samples a cell and axis): the
library's operator, which exports, and products with interpolation matrices, whose gradient is
several times faster on a CPU.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torchvision.ops import roi_align

SAMPLING_RATIO = 2
CANONICAL_SIZE_PX = 224.0
CANONICAL_LEVEL = 4


def assign_levels(boxes: Tensor, levels: tuple[int, ...]) -> Tensor:
    """Level of each (R, 4) xyxy px box -> (R,) int64, equation 1 of the FPN paper."""
    size = boxes[:, 2:] - boxes[:, :2]
    side = size.clamp(min=0.0).prod(dim=1).sqrt()
    level = torch.floor(CANONICAL_LEVEL + torch.log2(side / CANONICAL_SIZE_PX + 1e-8))
    return level.clamp(levels[0], levels[-1]).long()


def pool_regions(
    maps: dict[int, Tensor], boxes: Tensor, images: Tensor, levels: tuple[int, ...], cells: int
) -> Tensor:
    """Pool regions to (R, C, cells, cells).

    maps: level -> (B, C, h, w); boxes (R, 4) xyxy px of the input; images (R,) the image that
    each box lies in. Every region is pooled from every level and the assigned one is chosen,
    which costs more arithmetic than sorting regions by level but moves no data.
    """
    regions = torch.cat((images.to(boxes.dtype)[:, None], boxes), dim=1)
    pooled = [
        roi_align(maps[level].float(), regions, cells, 2.0**-level, SAMPLING_RATIO, aligned=True)
        for level in levels
    ]
    return _choose(pooled, boxes, levels)


def pool_regions_by_matrix(
    maps: dict[int, Tensor], boxes: Tensor, images: Tensor, levels: tuple[int, ...], cells: int
) -> Tensor:
    """What :func:`pool_regions` computes, for training; images must rise."""
    counts = torch.bincount(images, minlength=len(maps[levels[0]])).tolist()
    pooled = [_pool_level(maps[level], boxes, counts, 2.0**-level, cells) for level in levels]
    return _choose(pooled, boxes, levels)


def _choose(pooled: list[Tensor], boxes: Tensor, levels: tuple[int, ...]) -> Tensor:
    result = pooled[0]
    if len(levels) > 1:
        assigned = assign_levels(boxes, levels)[:, None, None, None]
        for level, candidate in zip(levels[1:], pooled[1:], strict=True):
            result = torch.where(assigned == level, candidate, result)
    return result


def _pool_level(
    feature: Tensor, boxes: Tensor, counts: list[int], scale: float, cells: int
) -> Tensor:
    """Interpolation is separable: along x for all regions of an image, then along y for each."""
    channels, height, width = feature.shape[1:]
    across = _interpolation(boxes[:, 0], boxes[:, 2], cells, width, scale).split(counts)  # type: ignore[no-untyped-call]
    down = _interpolation(boxes[:, 1], boxes[:, 3], cells, height, scale).split(counts)  # type: ignore[no-untyped-call]
    pooled = []
    for image, x, y in zip(feature.permute(0, 2, 3, 1), across, down, strict=True):
        columns = torch.matmul(x.reshape(1, -1, width), image)
        columns = columns.reshape(height, -1, cells * channels).transpose(0, 1)
        pooled.append(torch.matmul(y, columns).reshape(-1, cells, cells, channels))
    return torch.cat(pooled).permute(0, 3, 1, 2)


def _interpolation(low: Tensor, high: Tensor, cells: int, length: int, scale: float) -> Tensor:
    """Weights (R, cells, length) of an axis' samples in the mean of each cell.

    Samples over a cell outside the map count nothing, the others stick to its border, as in
    the library's operator.
    """
    step = (torch.arange(cells * SAMPLING_RATIO, device=low.device) + 0.5) / SAMPLING_RATIO / cells
    position = low[:, None] * scale - 0.5 + step * ((high - low) * scale)[:, None]
    inside = (position >= -1.0) & (position <= length)
    distance = position.clamp(0, length - 1)[..., None] - torch.arange(length, device=low.device)
    weight = (1.0 - distance.abs()).clamp(min=0.0) * inside[..., None]
    return weight.reshape(len(low), cells, SAMPLING_RATIO, length).mean(dim=2)
