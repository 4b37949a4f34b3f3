"""INT8 by static quantisation: activations unsigned, weights signed per channel (QDQ form)."""

from __future__ import annotations

import ast
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from edgetree.export.quiet import quiet

__all__ = ["quantise"]

_QUANTISED: Final = {"Conv", "Gemm", "Add", "Resize"}
_SCOPES: Final = "pkg.torch.onnx.name_scopes"
# Last layers, whose outputs are read as coordinates and probabilities: their rounding is seen
# directly in the results, and they are cheap.
FLOAT_LAYERS: Final = (
    "model.proposer.objectness",
    "model.proposer.shift",
    "model.box_head.score",
    "model.box_head.shift",
    "model.mask_head.score",
    "model.keypoint_head.tower.up",
)


def quantise(model: Any, frames: NDArray[np.uint8]) -> Any:
    """Quantise a traced ``onnx.ModelProto``.

    Args:
        model: as ``edgetree.export.graph.trace`` gives it, with the names of its modules.
        frames: (N, H, W, 3) or (N, H, W) uint8, real frames that show the range of activations;
            N is a multiple of the model's batch size.

    Returns:
        An ``onnx.ModelProto`` with the same inputs and outputs.
    """
    import onnx
    from onnxruntime.quantization import (
        CalibrationDataReader,
        CalibrationMethod,
        QuantFormat,
        QuantType,
        quantize_static,
    )

    batch = model.graph.input[0].type.tensor_type.shape.dim[0].dim_value

    class Reader(CalibrationDataReader):  # type: ignore[misc]
        def __init__(self) -> None:
            self.batches = iter(frames.reshape(-1, batch, *frames.shape[1:]))

        def get_next(self) -> dict[str, NDArray[np.uint8]] | None:
            images = next(self.batches, None)
            return None if images is None else {model.graph.input[0].name: images}

    with tempfile.TemporaryDirectory() as folder:
        # From a file, as quantize_static() moves a model's weights out of the one it is given.
        source, result = Path(folder) / "float32.onnx", Path(folder) / "int8.onnx"
        onnx.save(model, source)
        with quiet():
            quantize_static(
                source,
                result,
                Reader(),
                quant_format=QuantFormat.QDQ,
                activation_type=QuantType.QUInt8,
                weight_type=QuantType.QInt8,
                per_channel=True,
                calibrate_method=CalibrationMethod.MinMax,
                op_types_to_quantize=sorted(_QUANTISED),
                nodes_to_quantize=_nodes_to_quantise(model),
                extra_options={"WeightSymmetric": True, "ActivationSymmetric": False},
            )
        return onnx.load(result)


def _nodes_to_quantise(model: Any) -> list[str]:
    """Nodes of the network proper; the arithmetic on boxes around it stays float."""
    chosen = []
    for node in model.graph.node:
        scopes = _scopes(node)
        inside = any(scope.startswith("model.") for scope in scopes)
        kept = any(scope in FLOAT_LAYERS for scope in scopes)
        bilinear = node.op_type == "Resize" and "model.keypoint_head" in scopes
        if node.op_type in _QUANTISED and inside and not kept and not bilinear:
            chosen.append(node.name)
    return chosen


def _scopes(node: Any) -> list[str]:
    """The modules that a node comes from, outermost first."""
    for entry in node.metadata_props:
        if entry.key == _SCOPES:
            return [str(scope) for scope in ast.literal_eval(entry.value)]
    return []
