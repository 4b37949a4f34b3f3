"""Anchor boxes of the region proposal network (Ren et al. 2015, Faster R-CNN)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def level_anchors(
    rows: int,
    columns: int,
    stride: int,
    sizes_px: Sequence[float],
    ratios: Sequence[float],
    offset: float = 0.5,
) -> Tensor:
    """Make the anchors of one pyramid level.

    Args:
        rows: Rows of the level's feature map.
        columns: Columns of the level's feature map.
        stride: Size of a feature map cell in the input image, px.
        sizes_px: Square roots of the anchor areas, px.
        ratios: Height over width of the anchors.
        offset: Position of the anchor centres in their cell, as a fraction of its width and
            height: 0 is the upper left corner, 0.5 the centre.

    Returns:
        (rows * columns * sizes * ratios, 4) float32 xyxy px, in this order: the ratio varies
        fastest.
    """
    size, ratio = torch.tensor(sizes_px)[:, None], torch.tensor(ratios)[None].sqrt()
    half = 0.5 * torch.stack((size / ratio, size * ratio), dim=-1).reshape(-1, 2)
    y = (torch.arange(rows) + offset) * stride
    x = (torch.arange(columns) + offset) * stride
    below, right = torch.meshgrid(y, x, indexing="ij")
    centre = torch.stack((right, below), dim=-1).reshape(-1, 1, 2)
    return torch.cat((centre - half, centre + half), dim=-1).reshape(-1, 4)
