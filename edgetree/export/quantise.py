"""INT8 by static quantisation: weights signed per channel, activations unsigned (QDQ form)."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from edgetree.export.layers import frame_reader, last_products, network_nodes
from edgetree.export.quiet import quiet
from edgetree.export.stem import byte_range, take_bytes_as_quantised

__all__ = ["quantise"]

_QUANTISED: Final = {"Add", "Clip", "Conv", "Gemm", "MaxPool", "Relu", "Resize"}
_JOINING: Final = {"Concat", "Gather"}
# The last layers take 8 bits and give floats where they are products of matrices.
_FLOAT_OUTPUT: Final = "MatMul"


def quantise(model: Any, frames: NDArray[np.uint8], *, symmetric: bool = False) -> Any:
    """Quantise a traced ``onnx.ModelProto``.

    Args:
        model: as ``edgetree.export.graph.trace`` gives it for quantising, with the names of its
            modules.
        frames: (N, H, W, 3) or (N, H, W) uint8, real frames that show the range of activations;
            as many as fill the model's batches are taken.
        symmetric: activations signed about zero, as TensorRT takes them; a slow path on CPUs.

    Returns:
        An ``onnx.ModelProto`` with the same inputs and outputs.
    """
    import onnx
    from onnxruntime.quantization import (
        CalibrationMethod,
        QuantFormat,
        QuantType,
        quantize_static,
    )

    with tempfile.TemporaryDirectory() as folder:
        # From a file, as quantize_static() moves a model's weights out of the one it is given.
        source, result = Path(folder) / "float32.onnx", Path(folder) / "int8.onnx"
        onnx.save(model, source)
        with quiet():
            quantize_static(
                source,
                result,
                frame_reader(model, frames),
                quant_format=QuantFormat.QDQ,
                activation_type=QuantType.QInt8 if symmetric else QuantType.QUInt8,
                weight_type=QuantType.QInt8,
                per_channel=True,
                calibrate_method=CalibrationMethod.MinMax,
                op_types_to_quantize=sorted({*_QUANTISED, *_JOINING, _FLOAT_OUTPUT}),
                nodes_to_quantize=_nodes_to_quantise(model),
                extra_options={
                    "WeightSymmetric": True,
                    "ActivationSymmetric": symmetric,
                    "OpTypesToExcludeOutputQuantization": [_FLOAT_OUTPUT],
                    "TensorQuantOverrides": {} if symmetric else byte_range(model),
                },
            )
        quantised = onnx.load(result)
    if not symmetric:
        take_bytes_as_quantised(quantised)
    return quantised


def _nodes_to_quantise(model: Any) -> list[str]:
    network = [node for node in network_nodes(model) if node.op_type in _QUANTISED]
    return [node.name for node in (*network, *_joining_maps(model), *last_products(model))]


def _joining_maps(model: Any) -> list[Any]:
    """The nodes that lay the pyramid's maps side by side for RoIAlign."""
    makers = {output: node for node in model.graph.node for output in node.output}
    waiting = [node.input[0] for node in model.graph.node if node.op_type == "RoiAlign"]
    found: dict[str, Any] = {}
    while waiting:
        node = makers.get(waiting.pop())
        if node is not None and node.op_type in _JOINING and node.name not in found:
            found[node.name] = node
            waiting += node.input
    return list(found.values())
