"""Rewrite the first convolution of each backbone for 8 bits, to read the image's bytes directly.

With one or three input channels and stride 2, the first convolution is slow in 8-bit runtimes. With
the pixels of neighbouring columns as channels, it becomes a convolution that computes two columns
of its output at a time. Rows of bytes are stored in that order, so no byte is moved. The means of
blocks of pixels before it, and the normalisation, move into its weights, so that no float image is
needed.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from torch import Tensor, nn

    from perceptree.models import ModelSpec, TreeRCNN

_MAX_BYTE: Final = 255
_STRIDE_5: Final = 32
_COLUMNS: Final = 2
"""Columns of its output that the convolution makes at a time. With one, its matrix products are too
small to be fast; with four, more of their weights are 0."""


def read_bytes_in_first_convolution(model: TreeRCNN) -> None:
    """Change a model in place so that each first convolution reads columns of bytes.

    One value `zero`, the rounded mean over all channels, is subtracted from all bytes. With weight
    w, pixel x and channel mean m, `w (x - m) / std = w / std (x - zero) + w / std (zero - m)`. The
    last term is a bias. Around a colour image, where 0 stands for the mean in the original, each
    channel is its mean, rounded to a byte. For an image of one channel with three different means,
    or with a mean that is no whole number, no byte stands for the mean. There an additional channel
    of constant value, which is `zero` around the image, carries the last term.
    """
    spec = model.spec
    size = spec.height, spec.width
    one_channel = spec.modality != "rgb"
    model.normalise = _reading_bytes(  # type: ignore[method-assign,assignment]
        model.backbone, model.mean, model.std, size, spec.reduction, one_channel
    )
    if model.colour_backbone is not None:
        of_colour = model.colour_mean, model.colour_std, size, spec.colour_reduction, False
        model.normalise_colour = _reading_bytes(  # type: ignore[method-assign,assignment]
            model.colour_backbone, *of_colour
        )
    model.spec = without_std(spec)


def without_std(spec: ModelSpec) -> ModelSpec:
    """The spec of a network whose weights have taken in the division by standard deviations."""
    colour_std = tuple(1.0 for _ in spec.colour_std)
    return dataclasses.replace(spec, std=(1.0,) * spec.channels, colour_std=colour_std)


def _reading_bytes(
    backbone: nn.Module,
    mean: Tensor,
    std: Tensor,
    size: tuple[int, int],
    reduction: int,
    one_channel: bool,
) -> Callable[[Tensor], Tensor]:
    """Change the first convolution of a backbone; returns what prepares its images.

    Args:
        backbone: The backbone.
        mean: (C, 1, 1) mean per channel.
        std: (C, 1, 1) standard deviation per channel.
        size: Height and width of the images.
        reduction: Side of the blocks of pixels whose means the backbone gets.
        one_channel: Whether the images are (B, H, W), else (B, H, W, 3).
    """
    import torch
    from torch import nn

    means = mean.flatten()
    zero = int(means.mean().round())
    name, first = _first_convolution(backbone)
    weight = first.weight.detach() / std
    offset = (weight * (zero - means)[:, None, None]).sum(1, keepdim=True)
    around, bias = means.round().to(torch.uint8), offset.sum((1, 2, 3))
    constant = one_channel and bool((means != zero).any())
    if one_channel:
        weight = weight.sum(1, keepdim=True)
        around, bias = around.new_full((1 + constant,), zero), torch.zeros_like(bias)
    if constant:
        weight = torch.cat((weight, offset / (_MAX_BYTE - zero)), dim=1)
    # The mean of a block of pixels before a tap is a block of equal taps.
    weight = weight.repeat_interleave(reduction, 2).repeat_interleave(reduction, 3) / reduction**2
    stride, padding = 2 * reduction, reduction * int(first.padding[0])
    spread, (left, right) = _spread_over_columns(weight, padding, stride)
    outer, inner, *kernel = spread.shape
    convolution = nn.Conv2d(inner, outer, (kernel[0], kernel[1]), stride=(stride, 1))
    convolution.weight, convolution.bias = nn.Parameter(spread), nn.Parameter(bias.repeat(_COLUMNS))
    backbone.set_submodule(name, convolution)
    _take_columns_apart(backbone, name)
    side = stride * _COLUMNS
    below = max(weight.shape[2] - padding - stride, 0)
    down, across = (-length % _STRIDE_5 for length in size)
    borders = (left * side, right * side + across, padding, below + down)

    def normalise(images: Tensor) -> Tensor:
        """uint8 images -> (B, N, rows, blocks of columns) float32, less `zero`."""
        x = images[..., None] if one_channel else images
        if constant:
            x = torch.cat((x, torch.full_like(x, _MAX_BYTE)), dim=3)
        x = _surrounded(x, around, borders)
        batch, high, wide, channels = x.shape
        x = x.reshape(batch, high, wide // side, side * channels).permute(0, 3, 1, 2)
        return x.float() - float(zero)

    return normalise


def _surrounded(x: Tensor, values: Tensor, borders: Sequence[int]) -> Tensor:
    """(B, H, W, C) x with borders of (C,) values: left, right, top and bottom, in pixels."""
    import torch

    for axis, (before, after) in ((2, borders[:2]), (1, borders[2:])):
        parts = [x]
        for count, place in ((before, 0), (after, 2)):
            if count:
                shape = [*x.shape[:axis], count, *x.shape[axis + 1 :]]
                parts.insert(place, values.expand(shape))
        x = torch.cat(parts, dim=axis)
    return x


def _take_columns_apart(backbone: nn.Module, convolution: str) -> None:
    """Change what follows a convolution of several columns: its norm, and the order of its values.

    The columns are taken apart after the norm and the activation, which runtimes join with the
    convolution.
    """
    from torch import nn

    class Apart(nn.Module):
        def forward(self, x: Tensor) -> Tensor:
            """(B, 2 C, H, W / 2) -> (B, C, H, W)."""
            batch, channels, high, wide = x.shape
            x = x.permute(0, 2, 3, 1).reshape(batch, high, wide * _COLUMNS, channels // _COLUMNS)
            return x.permute(0, 3, 1, 2)

    parent, _, own = convolution.rpartition(".")
    owner = backbone.get_submodule(parent)
    names = [name for name, _ in owner.named_children()]
    after = names[names.index(own) + 1 :]
    norm: Any = copy.deepcopy(owner.get_submodule(after[0]))
    norm.num_features *= _COLUMNS
    for each in ("weight", "bias"):
        setattr(norm, each, nn.Parameter(getattr(norm, each).detach().repeat(_COLUMNS)))
    for each in ("running_mean", "running_var"):
        setattr(norm, each, getattr(norm, each).repeat(_COLUMNS))
    owner.set_submodule(after[0], norm)
    # The activation is a module of its own, or part of the norm.
    last = after[1] if not list(owner.get_submodule(after[1]).parameters()) else after[0]
    owner.set_submodule(last, nn.Sequential(owner.get_submodule(last), Apart()))


def _first_convolution(backbone: nn.Module) -> tuple[str, nn.Conv2d]:
    """The first convolution of a backbone, and its name."""
    from torch import nn

    parts = backbone.named_modules()
    name, first = next((name, part) for name, part in parts if isinstance(part, nn.Conv2d))
    side = first.kernel_size[0]
    if first.stride != (2, 2) or side % 2 == 0 or first.padding != (side // 2,) * 2:
        raise ValueError(f"{first}: expected stride 2 and the padding that keeps the size")
    return name, first


def _spread_over_columns(
    weight: Tensor, padding: int, stride: int
) -> tuple[Tensor, tuple[int, int]]:
    """The weight of the convolution that makes several columns of a convolution at a time.

    Its input has blocks of G S columns of pixels as channels, for G columns of output and stride S.
    Through tap j, column G b + g of the output reads column S (G b + g) + j - padding of the image.
    That is column (S g + j - padding) mod G S of block b + (S g + j - padding) div G S.

    Args:
        weight: (out, C, k, k) weight of the convolution of stride S.
        padding: Its padding in pixels.
        stride: S.

    Returns:
        The weight, with output channels `g * out + o` and input channels `column * C + channel` of
        a block, and the blocks that the convolution needs to the left and right of the image.
    """
    outer, inner, side, _ = weight.shape
    block = _COLUMNS * stride
    before = -(-padding // block)
    after = (stride * (_COLUMNS - 1) + side - 1 - padding) // block
    spread = weight.new_zeros(_COLUMNS, outer, block, inner, side, before + after + 1)
    for g in range(_COLUMNS):
        for j in range(side):
            place, column = divmod(stride * g + j - padding, block)
            spread[g, :, column, :, :, place + before] = weight[:, :, :, j]
    return spread.reshape(_COLUMNS * outer, block * inner, side, -1), (before, after)


def byte_range(model: Any) -> dict[str, list[dict[str, Any]]]:
    """Quantisation parameters with which the subtractions give the bytes of the images.

    The scale is 1 and the zero point is the value that is subtracted.

    Args:
        model: a traced `onnx.ModelProto`.

    Returns:
        Parameters by tensor, for `TensorQuantOverrides` of onnxruntime's quantiser.
    """
    import numpy as np

    return {
        subtract.output[0]: [
            {"scale": np.array(1.0, np.float32), "zero_point": np.array(zero, np.uint8)}
        ]
        for subtract, zero in _subtractions(model)
    }


def use_bytes_as_quantised(model: Any) -> None:
    """Remove the conversions from bytes to floats and back to bytes from a quantised model."""
    graph = model.graph
    for subtract, _ in _subtractions(model):
        cast = next(node for node in graph.node if subtract.input[0] in node.output)
        (quantise,) = (node for node in graph.node if subtract.output[0] in node.input)
        for node in graph.node:
            node.input[:] = [
                cast.input[0] if name == quantise.output[0] else name for name in node.input
            ]
        for node in (quantise, subtract, cast):
            graph.node.remove(node)


def _subtractions(model: Any) -> list[tuple[Any, float]]:
    """The nodes that subtract a constant from the bytes of each image, and those constants."""
    from onnx import numpy_helper

    makers = {output: node for node in model.graph.node for output in node.output}
    values = {value.name: value for value in model.graph.initializer}
    found: list[tuple[Any, float]] = []
    for node in model.graph.node:
        if node.op_type == "Sub" and node.input[1] in values:
            source = makers.get(node.input[0])
            if source is not None and source.op_type == "Cast":
                found.append((node, float(numpy_helper.to_array(values[node.input[1]]))))
            if len(found) == len(model.graph.input):
                return found
    raise ValueError(
        "the graph does not subtract a constant from each image: expected one traced for quantising"
    )
