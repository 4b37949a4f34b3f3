"""The first convolution on the camera's own bytes: no float image is made of them.

Of one or three channels and at full size, it is what 8-bit runtimes do worst. Blocks of 2x2
pixels as channels make it a convolution of stride 1 with four times the channels, and its
taps absorb what the normalisation subtracts.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from torch import Tensor, nn

    from perceptree.models import TreeRCNN

__all__ = ["read_bytes_in_stem", "take_bytes_as_quantised"]

_BRIGHTEST: Final = 255


def read_bytes_in_stem(model: TreeRCNN) -> None:
    """Change ``model``, to be traced, so that its first convolution reads blocks of bytes.

    The bytes count from ``zero``, the mean rounded, so that the zeros around an image stay what
    they are. What is left of each channel's mean comes from a channel of constant brightness.
    """
    import torch
    from torch.nn import functional

    spec = model.spec
    means = torch.tensor(spec.mean)
    zero = int(means.mean().round())
    name, first = _first_convolution(model)
    weight = first.weight.detach() / model.std
    offset = (weight * (zero - means)[:, None, None]).sum(1, keepdim=True)
    if spec.modality == "depth":
        weight = weight.sum(1, keepdim=True)
    constant = bool((means != zero).any())
    if constant:
        weight = torch.cat((weight, offset / (_BRIGHTEST - zero)), dim=1)
    stem, borders = _blocked(weight, int(first.padding[0]))
    model.backbone.set_submodule(name, stem)
    rows, columns = (32 * cells for cells in spec.map_size(5))
    padding = (0, 0, 0, columns - spec.width, 0, rows - spec.height)

    def normalise(images: Tensor) -> Tensor:
        """uint8 images -> (B, 4C, H / 2, W / 2) float32, counted from ``zero``."""
        x = images if spec.modality == "rgb" else images[..., None]
        if constant:
            x = torch.cat((x, torch.full_like(x[..., :1], _BRIGHTEST)), dim=3)
        if any(padding):
            x = functional.pad(x, padding, value=zero)
        batch, high, wide, channels = x.shape
        x = x.reshape(batch, high // 2, 2, wide // 2, 2 * channels).permute(0, 1, 3, 2, 4)
        x = x.reshape(batch, high // 2, wide // 2, 4 * channels).permute(0, 3, 1, 2)
        return functional.pad(x.float() - float(zero), borders)

    model.normalise = normalise  # type: ignore[method-assign]
    model.spec = dataclasses.replace(spec, std=(1.0,) * spec.channels)


def _first_convolution(model: TreeRCNN) -> tuple[str, nn.Conv2d]:
    from torch import nn

    parts = model.backbone.named_modules()
    name, first = next((name, part) for name, part in parts if isinstance(part, nn.Conv2d))
    side = first.kernel_size[0]
    if first.stride != (2, 2) or side % 2 == 0 or first.padding != (side // 2,) * 2:
        raise ValueError(f"{first}: expected stride 2 and the padding that keeps the size")
    return name, first


def _blocked(weight: Tensor, padding: int) -> tuple[nn.Conv2d, tuple[int, int, int, int]]:
    """(out, C, k, k) of stride 2 -> the convolution of 2x2 blocks, and the borders it needs.

    A block's channel is ``(row * 2 + column) * C + channel``.
    """
    from torch import nn

    outer, inner, side, _ = weight.shape
    before = (padding + 1) // 2
    after = (side - 1 - padding) // 2
    spread = weight.new_zeros(outer, 2, 2, inner, before + after + 1, before + after + 1)
    for i in range(side):
        for j in range(side):
            (y, row), (x, column) = divmod(i - padding, 2), divmod(j - padding, 2)
            spread[:, row, column, :, y + before, x + before] = weight[:, :, i, j]
    conv = nn.Conv2d(4 * inner, outer, before + after + 1, bias=False)
    conv.weight = nn.Parameter(spread.reshape(outer, 4 * inner, *conv.kernel_size))
    return conv, (before, after, before, after)


def byte_range(model: Any) -> dict[str, list[dict[str, Any]]]:
    """The range that bytes have, for the quantiser: scale 1, from the subtrahend on.

    ``model`` is a traced ``onnx.ModelProto``; the answer is by tensor, as
    ``TensorQuantOverrides`` of onnxruntime's quantiser takes it.
    """
    import numpy as np

    subtract, zero = _subtraction(model)
    values = {"scale": np.array(1.0, np.float32), "zero_point": np.array(zero, np.uint8)}
    return {subtract.output[0]: [values]}


def take_bytes_as_quantised(model: Any) -> None:
    """Drop the way from bytes over floats back to the same bytes from a quantised model."""
    graph = model.graph
    subtract, _ = _subtraction(model)
    cast = next(node for node in graph.node if subtract.input[0] in node.output)
    (quantise,) = (node for node in graph.node if subtract.output[0] in node.input)
    for node in graph.node:
        node.input[:] = [
            cast.input[0] if name == quantise.output[0] else name for name in node.input
        ]
    for node in (quantise, subtract, cast):
        graph.node.remove(node)


def _subtraction(model: Any) -> tuple[Any, float]:
    """The node that counts the bytes from a value, and that value."""
    from onnx import numpy_helper

    makers = {output: node for node in model.graph.node for output in node.output}
    values = {value.name: value for value in model.graph.initializer}
    for node in model.graph.node:
        if node.op_type == "Sub" and node.input[1] in values:
            source = makers.get(node.input[0])
            if source is not None and source.op_type == "Cast":
                return node, float(numpy_helper.to_array(values[node.input[1]]))
    raise ValueError("the graph does not count bytes from a value: expected a trace for quantising")
