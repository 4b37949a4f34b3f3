"""FP16 for GPUs: the network in half precision, its coordinates and large values in float32."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from edgetree.export.layers import frame_reader, network_nodes
from edgetree.export.quiet import quiet

__all__ = ["halve"]

LARGEST_HALF: Final = 65504.0
# Other frames than those seen may reach so many times their values.
_HEADROOM: Final = 4.0


def halve(model: Any, frames: NDArray[np.uint8]) -> Any:
    """Convert a traced ``onnx.ModelProto`` to float16 where that is safe.

    Whatever comes near the largest float16 on one of the frames stays float32, as does the
    arithmetic on boxes around the network. Inputs and outputs stay what they are.

    Args:
        model: as ``edgetree.export.graph.trace`` gives it.
        frames: (N, H, W, 3) or (N, H, W) uint8, real frames that show the range of activations.
    """
    from onnxruntime.transformers.float16 import convert_float_to_float16

    inside = network_nodes(model)
    reached = _largest_values(model, sorted({node.op_type for node in inside}), frames)
    safe = {
        node.name
        for node in inside
        if all(
            reached.get(name, 0.0) * _HEADROOM < LARGEST_HALF
            for name in (*node.input, *node.output)
        )
    }
    kept = [node.name for node in model.graph.node if node.name not in safe]
    with quiet():
        converted = convert_float_to_float16(
            model, keep_io_types=True, op_block_list=[], node_block_list=kept
        )
    return _without_detours(converted)


def _without_detours(model: Any) -> Any:
    """The converter's graph in order, with one cast of each kind and none to half and back.

    It rounds whatever passes between two nodes that stay float32, coordinates too.
    """
    from onnxruntime.transformers.onnx_model import OnnxModel

    graph = model.graph
    exact = {n.output[0]: n.input[0] for n in graph.node if n.name.endswith("_cast_to_fp16_node")}
    same = {
        node.output[0]: exact[node.input[0]]
        for node in graph.node
        if node.name.endswith("_cast_to_fp32_node") and node.input[0] in exact
    }
    once = {node.output[0]: node for node in graph.node if node.output[0] not in same}
    for node in once.values():
        outward = node.name.startswith("graph_output_cast")
        known = exact if outward else same
        node.input[:] = [known.get(name, name) for name in node.input]
    used = {value.name for value in graph.output}
    used.update(name for node in once.values() for name in node.input)
    nodes = [type(n).FromString(n.SerializeToString()) for n in once.values()]
    del graph.node[:]
    graph.node.extend(node for node in nodes if not used.isdisjoint(node.output))
    del graph.value_info[:]  # partly of tensors that are gone
    OnnxModel(model).topological_sort()
    return model


def _largest_values(model: Any, kinds: list[str], frames: NDArray[np.uint8]) -> dict[str, float]:
    """The largest absolute value of each tensor at nodes of such ``kinds``, over the frames."""
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
