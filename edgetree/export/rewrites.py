"""Rewrite a trained network into an equivalent one that inference runtimes run faster."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from edgetree.export.first_convolution import read_bytes_in_first_convolution, without_std

if TYPE_CHECKING:
    from torch import Tensor, nn

    from perceptree.models import TreeRCNN
    from perceptree.models.heads import MaskHead


def rewrite_for_export(model: TreeRCNN, *, quantised: bool) -> TreeRCNN:
    """A copy of a model with the same detections, ready to be traced.

    The division by the standard deviation of the input moves into the weights of the first
    convolution. Each transposed convolution of stride 2 becomes a sub-pixel convolution: a
    convolution with the four pixels of an upsampled cell as channels, followed by a pixel shuffle
    (Shi et al. 2016, Real-Time Single Image and Video Super-Resolution Using an Efficient
    Sub-Pixel Convolutional Neural Network). The mask head shuffles last, when one channel is left.

    Args:
        model: The model; it is not changed.
        quantised: Whether to prepare for 8 bits. Then the last layers become matrix
            multiplications, which take 8-bit inputs and give float outputs, and the first
            convolution reads bytes. Keypoints are read between the pixels of a heat map, also
            where the model reads them at the centres of pixels, so these may differ slightly.
    """
    import copy
    import dataclasses

    changed = copy.deepcopy(model)
    if quantised:
        read_bytes_in_first_convolution(changed)
    else:
        _divide_in_first_convolution(changed)
    if changed.mask_head is not None:
        _shuffle_after_score(changed.mask_head, quantised)
    if changed.keypoint_head is not None:
        tower: Any = changed.keypoint_head.tower
        tower.up = (_upsampling_matmul if quantised else _subpixel_convolution)(tower.up)
    if quantised:
        changed.pyramid.upsample = _by_repeating()  # type: ignore[assignment]
        proposer: Any = changed.proposer
        proposer.objectness = _pointwise_matmul(proposer.objectness)
        proposer.shift = _pointwise_matmul(proposer.shift)
        changed.spec = dataclasses.replace(changed.spec, keypoint_grid="subcell")
    return changed


def _divide_in_first_convolution(model: TreeRCNN) -> None:
    from torch import nn

    deviations = (model.std, model.colour_std)
    for backbone, std in zip(model.backbones, deviations, strict=False):
        first = next(part for part in backbone.modules() if isinstance(part, nn.Conv2d))
        first.weight = nn.Parameter(first.weight.detach() / std)
    model.spec = without_std(model.spec)


def _shuffle_after_score(head: MaskHead, quantised: bool) -> None:
    """Apply the mask's 1x1 convolution to all four pixels of an upsampled cell, then shuffle."""
    from torch import nn

    conv, shuffle = _subpixel_convolution(head.tower.up)
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
    last: Any = nn.Sequential(_pointwise_matmul(joined) if quantised else joined, shuffle)
    head.score = last


def _by_repeating() -> nn.Module:
    """Nearest-neighbour upsampling by 2 that copies rows and columns of pixels.

    onnxruntime's `Resize` of 8-bit maps works on one value after the other, in one thread.
    """
    import torch
    from torch import nn

    class Repeated(nn.Module):
        def forward(self, x: Tensor) -> Tensor:
            """(B, C, H, W) -> (B, C, 2 H, 2 W)."""
            x = x.permute(0, 2, 3, 1)
            for axis in (1, 2):
                rows = torch.arange(x.shape[axis]).repeat_interleave(2)
                x = torch.index_select(x, axis, rows)
            return x.permute(0, 3, 1, 2)

    return Repeated()


def _pointwise_matmul(layer: nn.Conv2d) -> nn.Module:
    """A 1x1 convolution as a matrix multiplication with channels last."""
    import torch
    from torch import nn

    class Pointwise(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.weight = nn.Parameter(layer.weight.detach().flatten(1).T.contiguous())
            assert layer.bias is not None
            # With four axes, since runtimes fuse a bias of one axis with the multiplication into
            # one in float.
            self.bias = nn.Parameter(layer.bias.detach()[None, None, None])

        def forward(self, x: Tensor) -> Tensor:
            """(B, C, H, W) -> (B, C', H, W)."""
            mapped = torch.matmul(x.permute(0, 2, 3, 1), self.weight) + self.bias
            return mapped.permute(0, 3, 1, 2)

    return Pointwise()


def _upsampling_matmul(layer: nn.ConvTranspose2d) -> nn.Module:
    """A transposed convolution of kernel 4 and stride 2 as a matrix multiplication and a sum.

    Each cell gives 4x4 output values, which overlap those of its neighbours by two.
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
            # Columns in the order (vertical half, horizontal half, channel, row, column): the 4x4
            # values are split into halves of 2x2 pixels.
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


def _subpixel_convolution(layer: nn.ConvTranspose2d) -> nn.Sequential:
    """A transposed convolution of stride 2 as a convolution and a pixel shuffle."""
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
    conv.weight = nn.Parameter(_subpixel_weight(layer.weight.detach(), int(padding), reach))
    if layer.bias is not None:
        conv.bias = nn.Parameter(layer.bias.detach().repeat_interleave(4))
    return nn.Sequential(conv, nn.PixelShuffle(2))


def _subpixel_weight(weight: Tensor, padding: int, reach: int) -> Tensor:
    """Weight of the sub-pixel convolution of a transposed convolution.

    Output pixel `2 c + i` of a transposed convolution of stride 2 gets input cell `c + d`
    through tap `t` with `2 (c + d) + t - padding = 2 c + i`, so `t = i + padding - 2 d`.

    Args:
        weight: (in, out, k, k) weight of the transposed convolution.
        padding: Its padding.
        reach: Largest distance d of a cell.

    Returns:
        (4 * out, in, 2 * reach + 1, 2 * reach + 1) weight.
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
