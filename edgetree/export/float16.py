"""Convert a traced graph to float16, keeping coordinates and large values in float32."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from basetree.arrays import UInt8
from edgetree.export.layers import frame_reader, network_nodes
from edgetree.export.quiet import quiet

# Largest finite float16 of IEEE 754: (2 - 2**-10) * 2**15.
_MAX_FLOAT16: Final = 65504.0
# Safety factor: other frames may give values this many times larger than the calibration frames.
_HEADROOM: Final = 4.0


def to_float16(model: Any, frames: UInt8) -> Any:
    """Convert a traced `onnx.ModelProto` to float16 where that is safe.

    Nodes whose values come near the largest float16 on any frame stay in float32, as do the last
    layers and the arithmetic on boxes. Inputs and outputs keep their types.

    Args:
        model: a graph from `edgetree.export.build.trace`.
        frames: (N, H, W, 3 or 4) or (N, H, W) uint8 real frames for the ranges of activations.

    Returns:
        The converted `onnx.ModelProto`.
    """
    from onnxruntime.transformers.float16 import convert_float_to_float16

    inside = network_nodes(model)
    reached = _largest_values(model, sorted({node.op_type for node in inside}), frames)
    safe = {
        node.name
        for node in inside
        if all(
            reached.get(name, 0.0) * _HEADROOM < _MAX_FLOAT16
            for name in (*node.input, *node.output)
        )
    }
    kept = [node.name for node in model.graph.node if node.name not in safe]
    with quiet():
        converted = convert_float_to_float16(
            model, keep_io_types=True, op_block_list=[], node_block_list=kept
        )
    return _without_redundant_casts(converted)


def _without_redundant_casts(model: Any) -> Any:
    """The converted graph without casts to float16 and back, sorted topologically.

    The converter puts such casts between nodes that stay in float32, which would round
    coordinates to float16.
    """
    from onnxruntime.transformers.onnx_model import OnnxModel

    graph = model.graph
    before_cast = {
        n.output[0]: n.input[0] for n in graph.node if n.name.endswith("_cast_to_fp16_node")
    }
    cast_back = {
        node.output[0]: before_cast[node.input[0]]
        for node in graph.node
        if node.name.endswith("_cast_to_fp32_node") and node.input[0] in before_cast
    }
    kept = {node.output[0]: node for node in graph.node if node.output[0] not in cast_back}
    for node in kept.values():
        is_output_cast = node.name.startswith("graph_output_cast")
        replacements = before_cast if is_output_cast else cast_back
        node.input[:] = [replacements.get(name, name) for name in node.input]
    used = {value.name for value in graph.output}
    used.update(name for node in kept.values() for name in node.input)
    nodes = [type(n).FromString(n.SerializeToString()) for n in kept.values()]
    del graph.node[:]
    graph.node.extend(node for node in nodes if not used.isdisjoint(node.output))
    del graph.value_info[:]  # some are of removed tensors
    OnnxModel(model).topological_sort()
    return model


def _largest_values(model: Any, kinds: list[str], frames: UInt8) -> dict[str, float]:
    """Largest absolute value over all frames of each tensor at nodes of some operator types.

    Args:
        model: An `onnx.ModelProto`.
        kinds: The operator types.
        frames: (N, H, W, 3 or 4) or (N, H, W) uint8 frames.
    """
    import onnx
    from onnxruntime.quantization import CalibrationMethod
    from onnxruntime.quantization.calibrate import create_calibrator

    with tempfile.TemporaryDirectory() as folder, quiet():
        source = Path(folder) / "float32.onnx"
        onnx.save(model, source)
        calibrator = create_calibrator(
            source,
            kinds,
            augmented_model_path=str(Path(folder) / "watched.onnx"),
            calibrate_method=CalibrationMethod.MinMax,
        )
        calibrator.collect_data(frame_reader(model, frames))
        ranges = calibrator.compute_data()
        del calibrator
    return {
        name: float(max(np.abs(value.lowest).max(), np.abs(value.highest).max()))
        for name, value in ranges.items()
    }
