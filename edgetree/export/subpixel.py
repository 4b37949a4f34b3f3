"""Transposed convolutions as plain ones: the form that every runtime runs fast and quantises."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor, nn

__all__ = ["with_subpixel_convolutions"]


def with_subpixel_convolutions(module: nn.Module) -> nn.Module:
    """A copy of ``module`` with the same answers and no transposed convolution of stride 2.

    Each becomes a convolution that makes the four pixels of a doubled cell as channels, and a
    shuffle of these (Shi et al. 2016).
    """
    import copy

    from torch import nn

    changed = copy.deepcopy(module)
    for parent in list(changed.modules()):
        for name, child in parent.named_children():
            if isinstance(child, nn.ConvTranspose2d):
                setattr(parent, name, _subpixel(child))
    return changed


def _subpixel(layer: nn.ConvTranspose2d) -> nn.Sequential:
    from torch import nn

    side, padding = layer.kernel_size[0], layer.padding[0]
    if isinstance(padding, str) or layer.stride != (2, 2) or side - 2 * int(padding) != 2:
        raise ValueError(f"{layer}: expected stride 2 and an output twice as large")
    reach = int(padding + 1) // 2
    conv = nn.Conv2d(
        layer.in_channels, 4 * layer.out_channels, 2 * reach + 1, padding=reach,
        bias=layer.bias is not None,
    )  # fmt: skip
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
