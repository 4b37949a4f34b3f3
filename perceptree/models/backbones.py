"""Backbones: images in, one feature map per level out, from the timm library."""

from __future__ import annotations

from typing import Any

import timm
from torch import Tensor, nn

from perceptree.models.spec import SpecError

# Our name -> timm's. Each gives a map at every stride from 2 to 32.
BACKBONES = {"mobilenetv4_conv_small": "mobilenetv4_conv_small"}


class Backbone(nn.Module):
    """A classifier's trunk from random weights, with batch norm that learns."""

    def __init__(self, name: str, in_channels: int, levels: tuple[int, ...]) -> None:
        super().__init__()
        if name not in BACKBONES:
            raise SpecError(f"unknown backbone {name!r}, expected one of: {', '.join(BACKBONES)}")
        trunk: Any = timm.create_model(
            BACKBONES[name],
            pretrained=False,
            features_only=True,
            in_chans=in_channels,
            out_indices=tuple(level - 1 for level in levels),
        )
        self.channels: tuple[int, ...] = tuple(trunk.feature_info.channels())
        self.trunk = trunk

    def forward(self, images: Tensor) -> list[Tensor]:
        """(B, C, H, W) normalised -> one (B, channels[i], H/2**level, W/2**level) per level."""
        maps: list[Tensor] = self.trunk(images)
        return maps
