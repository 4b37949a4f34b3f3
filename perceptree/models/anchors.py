"""Anchors: the boxes that proposals start from."""

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
    """Anchors of one level, (rows * columns * sizes * ratios, 4) xyxy px, ratios fastest.

    On each cell anchors are centred at ``offset`` of its width and height, with area
    ``size ** 2`` and height over width as in ``ratios``.
    """
    size, ratio = torch.tensor(sizes_px)[:, None], torch.tensor(ratios)[None].sqrt()
    half = 0.5 * torch.stack((size / ratio, size * ratio), dim=-1).reshape(-1, 2)
    y = (torch.arange(rows) + offset) * stride
    x = (torch.arange(columns) + offset) * stride
    below, right = torch.meshgrid(y, x, indexing="ij")
    centre = torch.stack((right, below), dim=-1).reshape(-1, 1, 2)
    return torch.cat((centre - half, centre + half), dim=-1).reshape(-1, 4)
