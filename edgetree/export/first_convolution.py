"""Rewrite the first convolution of each backbone for 8 bits, to read the image's bytes directly.

With one or three input channels at full resolution, the first convolution is slow in 8-bit
runtimes. With blocks of 2x2 pixels as channels (space to depth), it becomes a convolution of stride
1 with four times the channels. With blocks of 4x4, the means of 2x2 pixels before it are part of
it. The normalisation moves into its weights, so that no float image is needed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from torch import Tensor, nn

    from perceptree.models import ModelSpec, TreeRCNN

_MAX_BYTE: Final = 255
_STRIDE_5: Final = 32
# onnxruntime joins a constant to blocks of this side in less time than to their pixels. With 2x2
# pixels it is the other way round.
_MIN_JOINED_SIDE: Final = 4


def read_bytes_in_first_convolution(model: TreeRCNN) -> None:
    """Change a model in place so that each first convolution reads blocks of bytes.

    One value `zero`, the rounded mean over all channels, is subtracted from all bytes. The rest
    of each channel's mean comes from an additional channel of constant value: with weight w, pixel
    x and channel mean m, `w (x - m) / std = w / std (x - zero) + w / std (zero - m)`, and the
    sum of the last term over the channels is the weight of the additional channel times its value.
    Around the image all channels are 0, as in the original, where 0 stands for the mean.
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
    from torch.nn import functional

    means = mean.flatten()
    zero = int(means.mean().round())
    name, first = _first_convolution(backbone)
    weight = first.weight.detach() / std
    offset = (weight * (zero - means)[:, None, None]).sum(1, keepdim=True)
    if one_channel:
        weight = weight.sum(1, keepdim=True)
    constant = bool((means != zero).any())
    if constant:
        weight = torch.cat((weight, offset / (_MAX_BYTE - zero)), dim=1)
    # The mean of a block of pixels before a tap is a block of equal taps.
    weight = weight.repeat_interleave(reduction, 2).repeat_interleave(reduction, 3) / reduction**2
    side = 2 * reduction
    spread, borders = _spread_over_blocks(weight, reduction * int(first.padding[0]), side)
    down, across = (-length % _STRIDE_5 for length in size)
    padding = (0, 0, 0, across, 0, down)
    joined_to_blocks = constant and side >= _MIN_JOINED_SIDE
    if joined_to_blocks:
        by_pixel = spread.reshape(len(spread), side**2, -1, *spread.shape[2:])
        spread = torch.cat((by_pixel[:, :, :-1].flatten(1, 2), by_pixel[:, :, -1]), dim=1)
        image = torch.full((1, 1, *size), _MAX_BYTE, dtype=torch.uint8)
        image = functional.pad(image, (0, across, 0, down), value=zero)
        constant_blocks = functional.pixel_unshuffle(image, side)
    convolution = nn.Conv2d(spread.shape[1], len(spread), spread.shape[2], bias=False)
    convolution.weight = nn.Parameter(spread)
    backbone.set_submodule(name, convolution)

    def normalise(images: Tensor) -> Tensor:
        """uint8 images -> (B, N, H / S, W / S) float32 for blocks of side S, less `zero`."""
        x = images[..., None] if one_channel else images
        if constant and not joined_to_blocks:
            x = torch.cat((x, torch.full_like(x[..., :1], _MAX_BYTE)), dim=3)
        if any(padding):
            x = functional.pad(x, padding, value=zero)
        batch, high, wide, channels = x.shape
        x = x.reshape(batch, high // side, side, wide // side, side * channels)
        x = x.permute(0, 1, 3, 2, 4)
        x = x.reshape(batch, high // side, wide // side, side**2 * channels).permute(0, 3, 1, 2)
        if joined_to_blocks:
            x = torch.cat((x, constant_blocks.expand(batch, -1, -1, -1)), dim=1)
        return functional.pad(x.float() - float(zero), borders)

    return normalise


def _first_convolution(backbone: nn.Module) -> tuple[str, nn.Conv2d]:
    """The first convolution of a backbone, and its name."""
    from torch import nn

    parts = backbone.named_modules()
    name, first = next((name, part) for name, part in parts if isinstance(part, nn.Conv2d))
    side = first.kernel_size[0]
    if first.stride != (2, 2) or side % 2 == 0 or first.padding != (side // 2,) * 2:
        raise ValueError(f"{first}: expected stride 2 and the padding that keeps the size")
    return name, first


def _spread_over_blocks(
    weight: Tensor, padding: int, block: int
) -> tuple[Tensor, tuple[int, int, int, int]]:
    """The weight of the convolution of S x S blocks that equals a convolution of stride S.

    Through tap i, output row o reads the image row S o + i - padding. That is row
    (i - padding) mod S of the block row o + (i - padding) div S. Columns likewise.

    Args:
        weight: (out, C, k, k) weight of the convolution of stride S.
        padding: Its padding in pixels.
        block: S.

    Returns:
        The weight, whose input channels are `(row * S + column) * C + channel` of a block, and the
        padding in blocks that the convolution needs: left, right, top, bottom.
    """
    outer, inner, side, _ = weight.shape
    before = -(-padding // block)
    after = (side - 1 - padding) // block
    blocks = before + after + 1
    spread = weight.new_zeros(outer, block, block, inner, blocks, blocks)
    for i in range(side):
        for j in range(side):
            (y, row), (x, column) = divmod(i - padding, block), divmod(j - padding, block)
            spread[:, row, column, :, y + before, x + before] = weight[:, :, i, j]
    return spread.reshape(outer, -1, blocks, blocks), (before, after, before, after)


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
