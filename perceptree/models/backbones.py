"""Backbones: images in, one feature map per level out, from the timm library."""

from __future__ import annotations

from typing import Any

import timm
import torch
from torch import Tensor, nn

from perceptree.models.spec import SpecError

# Our name -> timm's. Each gives a map at every stride from 2 to 32.
BACKBONES = {"mobilenetv4_conv_small": "mobilenetv4_conv_small"}


class DepthwiseConv(nn.Conv2d):
    """A depthwise convolution that stays float32 under autocast.

    On CPUs the bfloat16 gradient of a depthwise convolution is up to ten times slower than the
    float32 one, and there is little arithmetic to save.
    """

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002
        """(B, C, H, W) -> (B, C, H', W'), as the plain convolution."""
        device = input.device.type
        if not torch.is_autocast_enabled(device):
            return super().forward(input)
        with torch.autocast(device, enabled=False):
            return super().forward(input.float())


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
        _keep_depthwise_float32(trunk)
        self.trunk = trunk

    def forward(self, images: Tensor) -> list[Tensor]:
        """(B, C, H, W) normalised -> one (B, channels[i], H/2**level, W/2**level) per level."""
        maps: list[Tensor] = self.trunk(images)
        return maps


def _keep_depthwise_float32(module: nn.Module) -> None:
    for name, child in module.named_children():
        if type(child) is nn.Conv2d and 1 < child.groups == child.in_channels:
            settings = {"stride": child.stride, "padding": child.padding, "groups": child.groups}
            replaced = DepthwiseConv(
                child.in_channels,
                child.out_channels,
                child.kernel_size,  # type: ignore[arg-type]
                bias=child.bias is not None,
                **settings,  # type: ignore[arg-type]
            )
            replaced.load_state_dict(child.state_dict())
            setattr(module, name, replaced)
        else:
            _keep_depthwise_float32(child)
