"""Pooling of regions from one or several pyramid levels, without scattering."""

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
    result: Tensor = pooled[0]
    if len(levels) > 1:
        assigned = assign_levels(boxes, levels)[:, None, None, None]
        for level, candidate in zip(levels[1:], pooled[1:], strict=True):
            result = torch.where(assigned == level, candidate, result)
    return result
