"""Quantise a traced graph to 8 bits.

Static quantisation in the QDQ format: signed weights with a scale per channel, unsigned
activations with a scale per tensor. Weights use 7 of their 8 bits. Processors with AVX2 but without
VNNI add two products of 8 bits in 16 bits, which overflows with full weights: the depth model then
lost 1.5 points of box AP and showed 40 % more false trees. With 7 bits it is the same everywhere;
`edgetree.export.rounding` makes up for much of what the missing bit costs.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from basetree.arrays import UInt8
from edgetree.export.first_convolution import byte_range, use_bytes_as_quantised
from edgetree.export.layers import frame_reader, last_matmuls, module_scopes, network_nodes
from edgetree.export.quiet import quiet
from edgetree.export.rounding import round_weights

_QUANTISED: Final = {"Add", "Clip", "Conv", "Gemm", "MaxPool", "Mul", "Relu", "Resize"}
_JOINING: Final = {"Concat", "Gather"}
_COPYING: Final = {"Gather", "Transpose"}
# Matrix multiplications, which the last layers are, take 8-bit inputs and give float outputs.
_FLOAT_OUTPUT: Final = "MatMul"


def weight_bits(*, symmetric: bool) -> int:
    """How many of their 8 bits the weights use; 8 overflow on processors without VNNI."""
    return 8 if symmetric else 7


def quantise(model: Any, frames: UInt8, *, symmetric: bool = False) -> Any:
    """Quantise a traced `onnx.ModelProto`.

    Args:
        model: a graph from `edgetree.export.build.trace` with `quantised=True`.
        frames: (N, H, W, 3 or 4) or (N, H, W) uint8 real frames for the ranges of activations.
            Those that do not fill a batch are left out.
        symmetric: Whether activations are signed with zero point 0, as TensorRT needs. This is
            slow on CPUs.

    Returns:
        An `onnx.ModelProto` with the same inputs and outputs.
    """
    import onnx
    from onnxruntime.quantization import (
        CalibrationMethod,
        QuantFormat,
        QuantType,
        quantize_static,
    )

    rounded, overrides = model, {}
    if not symmetric:
        rounded, scales = round_weights(model, frames, weight_bits(symmetric=False))
        overrides = byte_range(model) | {
            name: [_fixed(QuantType.QInt8, each) for each in scale]
            for name, scale in scales.items()
        }
    with tempfile.TemporaryDirectory() as folder:
        # quantize_static() removes the weights from a model given in memory, so pass a file.
        source, result = Path(folder) / "float32.onnx", Path(folder) / "int8.onnx"
        onnx.save(rounded, source)
        with quiet():
            quantize_static(
                source,
                result,
                frame_reader(model, frames),
                quant_format=QuantFormat.QDQ,
                activation_type=QuantType.QInt8 if symmetric else QuantType.QUInt8,
                weight_type=QuantType.QInt8,
                per_channel=True,
                reduce_range=weight_bits(symmetric=symmetric) < 8,
                calibrate_method=CalibrationMethod.MinMax,
                op_types_to_quantize=sorted({*_QUANTISED, *_JOINING, *_COPYING, _FLOAT_OUTPUT}),
                nodes_to_quantize=_nodes_to_quantise(model),
                extra_options={
                    "WeightSymmetric": True,
                    "ActivationSymmetric": symmetric,
                    "OpTypesToExcludeOutputQuantization": [_FLOAT_OUTPUT],
                    "TensorQuantOverrides": overrides,
                },
            )
        quantised = onnx.load(result)
    if not symmetric:
        use_bytes_as_quantised(quantised)
    return quantised


def _fixed(kind: Any, scale: np.float32) -> dict[str, Any]:
    """How one channel of weights is quantised: by a given scale, without an offset."""
    return {
        "axis": 0,
        "quant_type": kind,
        "scale": np.array(scale, np.float32),
        "zero_point": np.array(0, np.int8),
    }


def _nodes_to_quantise(model: Any) -> list[str]:
    network = [
        node
        for node in network_nodes(model)
        if node.op_type in _QUANTISED or _copies_pyramid_rows(node)
    ]
    return [node.name for node in (*network, *_pyramid_joins(model), *last_matmuls(model))]


def _copies_pyramid_rows(node: Any) -> bool:
    """Whether a node is a part of the pyramid's upsampling by `rewrites`."""
    return node.op_type in _COPYING and "model.pyramid.upsample" in module_scopes(node)


def _pyramid_joins(model: Any) -> list[Any]:
    """The nodes that concatenate the maps of the feature pyramid for RoIAlign."""
    makers = {output: node for node in model.graph.node for output in node.output}
    waiting = [node.input[0] for node in model.graph.node if node.op_type == "RoiAlign"]
    found: dict[str, Any] = {}
    while waiting:
        node = makers.get(waiting.pop())
        if node is not None and node.op_type in _JOINING and node.name not in found:
            found[node.name] = node
            waiting += node.input
    return list(found.values())
