"""Round the weights of convolutions so that their outputs change least.

GPTQ (Frantar et al. 2023, "GPTQ: accurate post-training quantization for generative pre-trained
transformers"), for convolutions: the weights of a kernel are rounded one after the other, and each
error is made up for in the weights that are not rounded yet, by the second moments of the inputs.
The square error of a layer's outputs is then smaller than with each weight rounded to the nearest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from basetree.arrays import Float32, Float64, UInt8
from edgetree.export.layers import frame_reader, network_nodes

_FRAMES: Final = 16
_WINDOWS: Final = 400
"""Windows of a map of which the inputs are taken, for each frame."""
_MOST_REGIONS: Final = 16
"""Regions of a batch of which the inputs of the heads are taken."""
_LARGEST_KERNEL: Final = 1024
"""Weights of a kernel. Larger ones, as in the paper's networks, are left as they are and rounded
to the nearest value later: the second moments grow with the square of this number."""
_DAMPING: Final = 0.01
"""Added to the diagonal of the second moments, as a share of its mean, as in the paper."""


@dataclass(frozen=True)
class _Convolution:
    """A convolution node, with the sizes that its inputs are cut out by."""

    source: str
    weight: str
    groups: int
    kernel: tuple[int, int]
    strides: tuple[int, int]

    @classmethod
    def of(cls, node: Any, weight: Float32) -> _Convolution:
        from onnx.helper import get_attribute_value

        given = {each.name: get_attribute_value(each) for each in node.attribute}
        rows, columns = weight.shape[2:]
        down, across = given.get("strides", (1, 1))
        groups = given.get("group", 1)
        return cls(node.input[0], node.input[1], groups, (rows, columns), (down, across))

    def inputs(self, maps: Float32, rng: np.random.Generator) -> Float32:
        """(groups, windows, weights of a kernel) inputs at random places inside (N, C, H, W)."""
        maps = maps[:_MOST_REGIONS]
        count, channels, height, width = maps.shape
        rows, columns = self.kernel
        down, across = self.strides
        tall, wide = (height - rows) // down + 1, (width - columns) // across + 1
        if count == 0 or tall < 1 or wide < 1:
            return np.zeros((self.groups, 0, channels // self.groups * rows * columns), np.float32)
        image, top, left = np.unravel_index(
            rng.integers(count * tall * wide, size=_WINDOWS), (count, tall, wide)
        )
        y = (top * down)[:, None, None] + np.arange(rows)[:, None]
        x = (left * across)[:, None, None] + np.arange(columns)
        windows = maps.transpose(0, 2, 3, 1)[image[:, None, None], y, x]
        grouped: Float32 = windows.reshape(len(image), rows * columns, self.groups, -1)
        return grouped.transpose(2, 0, 3, 1).reshape(self.groups, len(image), -1)


def round_weights(model: Any, frames: UInt8, bits: int) -> tuple[Any, dict[str, Float32]]:
    """Round the weights of the network's convolutions to whole multiples of a scale.

    Kernels of more than 1,024 weights are left as they are.

    Args:
        model: a traced `onnx.ModelProto` in float32; it is not changed.
        frames: (N, H, W, 3 or 4) or (N, H, W) uint8 real frames, of which the first 16 are used.
        bits: Bits of a weight with its sign.

    Returns:
        A copy of the model with rounded weights, and the scale of each output channel by the name
        of the weights.
    """
    import onnx
    from onnx import numpy_helper

    rounded = onnx.ModelProto()
    rounded.CopyFrom(model)
    stored = {each.name: each for each in rounded.graph.initializer}
    weights = {
        node.input[1]: np.array(numpy_helper.to_array(stored[node.input[1]]))
        for node in network_nodes(model)
        if node.op_type == "Conv" and node.input[1] in stored
    }
    weights = {name: w for name, w in weights.items() if w[0].size <= _LARGEST_KERNEL}
    if not weights:
        return rounded, {}
    convolutions = [
        _Convolution.of(node, weights[node.input[1]])
        for node in network_nodes(model)
        if node.op_type == "Conv" and node.input[1] in weights
    ]
    moments = _second_moments(model, convolutions, frames)
    most, scales = 2 ** (bits - 1), {}
    for name, weight in weights.items():
        scale = np.maximum(np.abs(weight).max((1, 2, 3)) / most, np.finfo(np.float32).tiny)
        groups = len(moments[name])
        kernels = weight.reshape(groups, len(weight) // groups, -1).astype(np.float64)
        steps = scale.reshape(groups, -1).astype(np.float64)
        made = _rounded(kernels, steps, moments[name], most).reshape(weight.shape)
        stored[name].CopyFrom(numpy_helper.from_array(made.astype(np.float32), name))
        scales[name] = scale.astype(np.float32)
    return rounded, scales


def _second_moments(
    model: Any, convolutions: list[_Convolution], frames: UInt8
) -> dict[str, Float64]:
    """(groups, weights, weights) sums of products of each kernel's inputs, by its weights."""
    import onnx
    import onnxruntime

    sources = list(dict.fromkeys(each.source for each in convolutions))
    shown = onnx.ModelProto()
    shown.CopyFrom(model)
    del shown.graph.output[:]
    shown.graph.output.extend(onnx.ValueInfoProto(name=name) for name in sources)
    session = onnxruntime.InferenceSession(
        shown.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    reader, rng = frame_reader(model, frames[:_FRAMES]), np.random.default_rng(0)
    found: dict[str, Float64] = {}
    while (batch := reader.get_next()) is not None:
        maps = dict(zip(sources, session.run(sources, batch), strict=True))
        for each in convolutions:
            inputs = each.inputs(maps[each.source], rng)
            products = (inputs.transpose(0, 2, 1) @ inputs).astype(np.float64)
            found[each.weight] = found.get(each.weight, 0.0) + products
    return found


def _rounded(kernels: Float64, scales: Float64, moments: Float64, most: int) -> Float64:
    """Round (G, O, K) kernels of G groups by (G, O) scales and their inputs' (G, K, K) moments."""
    size = moments.shape[-1]
    means = np.trace(moments, axis1=1, axis2=2) / size
    damping = np.where(means > 0, _DAMPING * means, 1.0)
    inverse = np.linalg.inv(moments + damping[:, None, None] * np.eye(size))
    factors = np.linalg.cholesky(inverse).transpose(0, 2, 1)
    waiting, made = kernels.copy(), np.empty_like(kernels)
    for place in range(size):
        wanted = waiting[..., place]
        made[..., place] = np.clip(np.rint(wanted / scales), -most, most) * scales
        error = (wanted - made[..., place]) / factors[:, place, place, None]
        waiting[..., place:] -= error[..., None] * factors[:, None, place, place:]
    return made
