"""Anchors: the boxes that proposals start from."""

from __future__ import annotations

import torch
from torch import Tensor


def level_anchors(
    height: int, width: int, stride: int, size_px: float, ratios: tuple[float, ...]
) -> Tensor:
    """Anchors of one level, (height * width * len(ratios), 4) xyxy px, ratios fastest.

    ``height`` and ``width`` count cells; an anchor is centred on each, with area
    ``size_px ** 2`` and height over width as in ``ratios``.
    """
    ratio = torch.tensor(ratios)
    half = 0.5 * torch.stack((size_px / ratio.sqrt(), size_px * ratio.sqrt()), dim=-1)
    y = (torch.arange(height) + 0.5) * stride
    x = (torch.arange(width) + 0.5) * stride
    rows, columns = torch.meshgrid(y, x, indexing="ij")
    centre = torch.stack((columns, rows), dim=-1).reshape(-1, 1, 2)
    return torch.cat((centre - half, centre + half), dim=-1).reshape(-1, 4)
