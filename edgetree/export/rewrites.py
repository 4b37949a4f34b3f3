"""A trained network in the form that runtimes run fastest, with the same answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from edgetree.export.stem import read_bytes_in_stem

if TYPE_CHECKING:
    from torch import Tensor, nn

    from perceptree.models import TreeRCNN
    from perceptree.models.heads import MaskHead

__all__ = ["deployable"]


def deployable(model: TreeRCNN, *, quantised: bool) -> TreeRCNN:
    """A copy of ``model`` with the same answers, to be traced.

    The division by std goes into the first convolution. Each transposed convolution of stride 2
    becomes one that makes the four pixels of a doubled cell as channels, and a shuffle of these
    (Shi et al. 2016), which for masks comes last, when one channel is left.

    ``quantised`` prepares for 8 bits: the last layers are products of matrices, which take 8 bits
    and give floats; the first convolution reads bytes; and keypoints that lie on a box's pixels
    are read between them, where the same surface is highest.
    """
    import copy
    import dataclasses

    changed = copy.deepcopy(model)
    if quantised:
        read_bytes_in_stem(changed)
    else:
        _divide_in_first_convolution(changed)
    if changed.mask_head is not None:
        _shuffle_last(changed.mask_head, quantised)
    if changed.keypoint_head is not None:
        tower: Any = changed.keypoint_head.tower
        tower.up = (_overlapping if quantised else _subpixel)(tower.up)
    if quantised:
        proposer: Any = changed.proposer
        proposer.objectness = _pointwise(proposer.objectness)
        proposer.shift = _pointwise(proposer.shift)
        changed.spec = dataclasses.replace(changed.spec, keypoint_grid="subcell")
    return changed


def _divide_in_first_convolution(model: TreeRCNN) -> None:
    import dataclasses

    from torch import nn

    first = next(part for part in model.backbone.modules() if isinstance(part, nn.Conv2d))
    first.weight = nn.Parameter(first.weight.detach() / model.std)
    model.spec = dataclasses.replace(model.spec, std=(1.0,) * model.spec.channels)


def _shuffle_last(head: MaskHead, quantised: bool) -> None:
    """Have the mask's 1x1 convolution read all four pixels of a doubled cell, then shuffle."""
    from torch import nn

    conv, shuffle = _subpixel(head.tower.up)
    weight = head.score.weight.detach()[0]
    joined = nn.Conv2d(4 * len(weight), 4, 1)
    spread = weight.new_zeros(4, len(weight), 4, 1, 1)
    for pixel in range(4):
        spread[pixel, :, pixel] = weight
    joined.weight = nn.Parameter(spread.flatten(1, 2))
    assert head.score.bias is not None
    joined.bias = nn.Parameter(head.score.bias.detach().repeat(4))
    tower: Any = head.tower
    tower.up = conv
    last: Any = nn.Sequential(_pointwise(joined) if quantised else joined, shuffle)
    head.score = last


def _pointwise(layer: nn.Conv2d) -> nn.Module:
    """A 1x1 convolution as a product of matrices, for runtimes that hold channels last."""
    import torch
    from torch import nn

    class Pointwise(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.weight = nn.Parameter(layer.weight.detach().flatten(1).T.contiguous())
            assert layer.bias is not None
            # Of four axes, so that runtimes do not merge it with the product into a float one.
            self.bias = nn.Parameter(layer.bias.detach()[None, None, None])

        def forward(self, x: Tensor) -> Tensor:
            """(B, C, H, W) -> (B, C', H, W)."""
            mapped = torch.matmul(x.permute(0, 2, 3, 1), self.weight) + self.bias
            return mapped.permute(0, 3, 1, 2)

    return Pointwise()


def _overlapping(layer: nn.ConvTranspose2d) -> nn.Module:
    """A transposed convolution of kernel 4 and stride 2 as a product of matrices, and a sum.

    Each cell makes 4x4 values, which overlap those of its neighbours by two.
    """
    import torch
    from torch import nn
    from torch.nn import functional

    if layer.kernel_size != (4, 4) or layer.stride != (2, 2) or layer.padding != (1, 1):
        raise ValueError(f"{layer}: expected kernel 4, stride 2 and padding 1")
    assert layer.bias is not None
    channels, bias = layer.out_channels, layer.bias.detach()

    class Overlapping(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            # Columns (down, across, channel, row, column): halves of the 4x4, and pixels in these.
            taps = layer.weight.detach().reshape(-1, channels, 2, 2, 2, 2)
            self.weight = nn.Parameter(taps.permute(0, 2, 4, 1, 3, 5).flatten(1).contiguous())

        def forward(self, x: Tensor) -> Tensor:
            """(R, C, H, W) -> (R, C', 2H, 2W)."""
            regions, _, high, wide = x.shape
            taps = torch.matmul(x.permute(0, 2, 3, 1), self.weight).permute(0, 3, 1, 2)
            parts = taps.reshape(regions, 2, 2, 4 * channels, high, wide)
            total = sum(
                functional.pad(parts[:, i, j], (j, 1 - j, i, 1 - i)) for i in (0, 1) for j in (0, 1)
            )
            doubled = functional.pixel_shuffle(total, 2)[:, :, 1:-1, 1:-1]  # type: ignore[arg-type]
            return doubled + bias[:, None, None]

    return Overlapping()


def _subpixel(layer: nn.ConvTranspose2d) -> nn.Sequential:
    from torch import nn

    side, padding = layer.kernel_size[0], layer.padding[0]
    if isinstance(padding, str) or layer.stride != (2, 2) or side - 2 * int(padding) != 2:
        raise ValueError(f"{layer}: expected stride 2 and an output twice as large")
    reach = int(padding + 1) // 2
    conv = nn.Conv2d(
        layer.in_channels,
        4 * layer.out_channels,
        2 * reach + 1,
        padding=reach,
        bias=layer.bias is not None,
    )
    conv.weight = nn.Parameter(_spread_taps(layer.weight.detach(), int(padding), reach))
    if layer.bias is not None:
        conv.bias = nn.Parameter(layer.bias.detach().repeat_interleave(4))
    return nn.Sequential(conv, nn.PixelShuffle(2))


def _spread_taps(weight: Tensor, padding: int, reach: int) -> Tensor:
    """(in, out, k, k) of a transposed convolution -> (4 * out, in, 2 * reach + 1, same).

    Pixel i of a doubled cell takes tap ``i + padding - 2 * d`` from the cell at distance d.
    """
    inner, outer, side, _ = weight.shape
    width = 2 * reach + 1
    spread = weight.new_zeros(outer, 2, 2, inner, width, width)
    taps = [
        (pixel, d + reach, pixel + padding - 2 * d)
        for pixel in (0, 1)
        for d in range(-reach, reach + 1)
        if 0 <= pixel + padding - 2 * d < side
    ]
    for i, row, tap_y in taps:
        for j, column, tap_x in taps:
            spread[:, i, j, :, row, column] = weight[:, :, tap_y, tap_x].T
    return spread.reshape(4 * outer, inner, width, width)
