"""Backbones from the timm library: convolutional networks that return one map per level."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, TypeVar

import timm
import torch
from torch import Tensor, nn

from perceptree.models.cpu_gradients import depthwise_conv
from perceptree.models.spec import SpecError

# Our name -> timm's name. Each has feature maps at the strides 2, 4, 8, 16 and 32.
BACKBONES = {
    "efficientnet_lite0": "efficientnet_lite0",
    "efficientnet_lite1": "efficientnet_lite1",
    "efficientnet_lite2": "efficientnet_lite2",
    "mobilenetv3_large": "mobilenetv3_large_100",
    "mobilenetv4_conv_small": "mobilenetv4_conv_small",
    "mobilenetv4_conv_medium": "mobilenetv4_conv_medium",
    "resnet18": "resnet18",
    "resnet50": "resnet50",
    "resnet101": "resnet101",
    "resnext101_32x4d": "resnext101_32x4d",
    "resnext101_32x8d": "resnext101_32x8d",
}


class DepthwiseConv(nn.Conv2d):
    """A depthwise convolution that is computed in float32 under autocast.

    On CPUs the bfloat16 gradient of a depthwise convolution takes up to ten times as long as the
    float32 one. On CPUs the gradient of the weights is computed by
    `perceptree.models.cpu_gradients.depthwise_conv`.
    """

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002
        """Map (B, C, H, W) to (B, C, H', W') as `nn.Conv2d` does."""
        device = input.device.type
        if not torch.amp.is_autocast_available(device) or not torch.is_autocast_enabled(device):
            return self._convolve(input)
        with torch.autocast(device, enabled=False):
            return self._convolve(input.float())

    def _convolve(self, x: Tensor) -> Tensor:
        learns = torch.is_grad_enabled() and self.weight.requires_grad
        if (
            not learns
            or not self._has_kernel
            or x.device.type != "cpu"
            or torch.compiler.is_compiling()
        ):
            return super().forward(x)
        return depthwise_conv(x, self.weight, self.stride[0], int(self.padding[0]))

    @property
    def _has_kernel(self) -> bool:
        """Whether the CPU kernel supports this convolution's options."""
        sides = set(zip(self.kernel_size, self.stride, self.padding, strict=True))
        usual = self.dilation == (1, 1) and self.padding_mode == "zeros" and self.bias is None
        return usual and len(sides) == 1 and self.in_channels == self.out_channels


class FoldingConv(nn.Conv2d):
    """A convolution that includes the batch norm after it while that norm's statistics are fixed.

    The norm's scale and shift go into the convolution's weight and bias, which is faster than
    scaling the map. The norm, a `FoldedNorm`, then returns its input unchanged.
    """

    _norm: tuple[FoldedNorm]
    """In a tuple, so that torch does not register it as a submodule."""

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002
        """Map (B, C, H, W) to (B, C', H', W')."""
        (norm,) = self._norm
        if not norm.folded:
            return super().forward(input)
        scale, shift = norm.scale_and_shift()
        weight = self.weight * scale[:, None, None, None]
        mapped: Tensor = self._conv_forward(input, weight, shift)
        return mapped


class FoldedNorm(nn.BatchNorm2d):
    """The batch norm after a `FoldingConv`."""

    @property
    def folded(self) -> bool:
        """Whether the convolution includes this norm: in eval mode, except during an export."""
        return not self.training and not torch.compiler.is_exporting()

    def scale_and_shift(self) -> tuple[Tensor, Tensor]:
        """The factor and the offset (C,) that the norm applies to each channel."""
        assert self.running_mean is not None
        assert self.running_var is not None
        scale = self.weight * torch.rsqrt(self.running_var + self.eps)
        return scale, self.bias - self.running_mean * scale

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002
        """Normalise (B, C, H, W); return it unchanged where the convolution includes the norm."""
        return input if self.folded else super().forward(input)


class Backbone(nn.Module):
    """An image classification network without its classifier, with random weights.

    Args:
        name: A key of `BACKBONES`.
        in_channels: Channels of the input.
        levels: Levels to return, 1 to 5; the map of level `n` has stride `2**n`.
        stride_in_1x1: Put the stride of a ResNet's bottleneck into its first 1x1 convolution, as
            in He et al. (2016) and in Detectron2's R50 and R101, not into the 3x3 one.

    Attributes:
        channels: Channels of the map of each level.

    Raises:
        SpecError: If the backbone is unknown, or has no bottlenecks for `stride_in_1x1`.
    """

    def __init__(
        self, name: str, in_channels: int, levels: tuple[int, ...], stride_in_1x1: bool = False
    ) -> None:
        super().__init__()
        self.trunk = make_timm(
            name,
            stride_in_1x1,
            features_only=True,
            in_chans=in_channels,
            out_indices=tuple(level - 1 for level in levels),
        )
        self.channels: tuple[int, ...] = tuple(self.trunk.feature_info.channels())
        _drop_unused(self.trunk, self.trunk.feature_info.module_name()[-1])
        _keep_depthwise_float32(self.trunk)
        _fold_norms(self.trunk)

    def forward(self, images: Tensor) -> list[Tensor]:
        """Compute the feature maps of normalised images.

        Args:
            images: (B, C, H, W), H and W multiples of 32.

        Returns:
            One (B, channels[i], H / 2**level, W / 2**level) map per level, finest first.
        """
        maps: list[Tensor] = self.trunk(images)
        return maps

    def stages(self) -> list[tuple[int, nn.Module]]:
        """The network's parts in order, each with the level it belongs to.

        The output of a part of level `n` has stride at most `2**n`.
        """
        info: list[dict[str, Any]] = self.trunk.feature_info.info
        ends = {entry["module"]: entry["reduction"].bit_length() - 1 for entry in info}
        parts: list[tuple[str, nn.Module]] = []
        for name, module in self.trunk.named_children():
            inner = module.named_children() if name == "blocks" else [("", module)]
            parts += [(f"{name}.{key}".rstrip("."), part) for key, part in inner]
        level, levels = ends[self.trunk.feature_info.module_name()[-1]], []
        for name, _ in reversed(parts):
            level = ends.get(name, level)
            levels.append(level)
        return [(n, part) for n, (_, part) in zip(reversed(levels), parts, strict=True)]


def make_timm(name: str, stride_in_1x1: bool, **settings: Any) -> Any:
    """Create a network of the timm library, with random weights.

    Args:
        name: A key of `BACKBONES`.
        stride_in_1x1: As for `Backbone`.
        **settings: Passed on to `timm.create_model`.

    Raises:
        SpecError: If the backbone is unknown, or has no bottlenecks for `stride_in_1x1`.
    """
    if name not in BACKBONES:
        raise SpecError(f"backbone is {name!r}, expected one of: {', '.join(BACKBONES)}")
    network: Any = timm.create_model(BACKBONES[name], pretrained=False, **settings)
    if stride_in_1x1:
        moved = [_move_stride(block) for block in network.modules()]
        if not any(moved):
            raise SpecError(
                f"stride_in_1x1 is true for {name}, expected a ResNet with bottleneck blocks"
            )
    return network


def _move_stride(block: nn.Module) -> bool:
    """Move the stride of a bottleneck from its 3x3 convolution to its first 1x1 convolution.

    Returns whether `block` is a bottleneck.
    """
    first, second = getattr(block, "conv1", None), getattr(block, "conv2", None)
    if not isinstance(first, nn.Conv2d) or not isinstance(second, nn.Conv2d):
        return False
    if not hasattr(block, "conv3"):
        return False
    first.stride, second.stride = second.stride, (1, 1)
    return True


def _drop_unused(trunk: Any, last: str) -> None:
    """Drop the blocks after the last one that is asked for, which timm keeps in some networks."""
    kind, _, number = last.partition(".")
    if kind == "blocks":
        trunk.blocks = trunk.blocks[: int(number) + 1]


def _keep_depthwise_float32(module: nn.Module) -> None:
    for name, child in module.named_children():
        if type(child) is nn.Conv2d and 1 < child.groups == child.in_channels:
            setattr(module, name, _conv_like(child, DepthwiseConv))
        else:
            _keep_depthwise_float32(child)


def _fold_norms(module: nn.Module) -> None:
    """Replace each pair of a convolution without bias and a batch norm by the foldable classes."""
    children = list(module.named_children())
    for (name, conv), (after, norm) in pairwise(children):
        if type(conv) is nn.Conv2d and conv.bias is None and type(norm) is nn.BatchNorm2d:
            folding, folded = _conv_like(conv, FoldingConv), FoldedNorm(norm.num_features, norm.eps)
            folded.load_state_dict(norm.state_dict())
            folding._norm = (folded,)
            setattr(module, name, folding)
            setattr(module, after, folded)
    for _, child in children:
        _fold_norms(child)


Conv = TypeVar("Conv", bound=nn.Conv2d)


def _conv_like(conv: nn.Conv2d, kind: type[Conv]) -> Conv:
    """Copy a convolution into another class."""
    made = kind(
        conv.in_channels,
        conv.out_channels,
        conv.kernel_size,  # type: ignore[arg-type]
        conv.stride,  # type: ignore[arg-type]
        conv.padding,  # type: ignore[arg-type]
        groups=conv.groups,
        bias=conv.bias is not None,
    )
    made.load_state_dict(conv.state_dict())
    return made
