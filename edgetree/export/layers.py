"""Select nodes of a traced graph by the module they come from, and feed calibration frames."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from typing import Any, Final

import numpy as np

from basetree.arrays import UInt8

_SCOPES: Final = "pkg.torch.onnx.name_scopes"
LAST_LAYERS: Final = (
    "model.proposer.objectness",
    "model.proposer.shift",
    "model.box_head.score",
    "model.box_head.shift",
    "model.mask_head.score",
    "model.keypoint_head.tower.up",
)
"""Modules whose outputs are coordinates and scores, so that rounding them changes the results."""


def module_scopes(node: Any) -> list[str]:
    """Names of the modules that a node comes from, outermost first."""
    for entry in node.metadata_props:
        if entry.key == _SCOPES:
            return [str(scope) for scope in ast.literal_eval(entry.value)]
    return []


def network_nodes(model: Any) -> list[Any]:
    """Nodes of the network, without its last layers and without the arithmetic on boxes."""
    chosen = []
    for node in model.graph.node:
        scopes = module_scopes(node)
        inside = any(scope.startswith("model.") for scope in scopes)
        last = any(scope in LAST_LAYERS for scope in scopes)
        bilinear = node.op_type == "Resize" and "model.keypoint_head" in scopes
        if inside and not last and not bilinear:
            chosen.append(node)
    return chosen


def last_matmuls(model: Any) -> list[Any]:
    """Matrix multiplications of the last layers."""
    return [
        node
        for node in model.graph.node
        if node.op_type == "MatMul" and any(s in LAST_LAYERS for s in module_scopes(node))
    ]


def frame_reader(model: Any, frames: UInt8) -> Any:
    """A calibration data reader of onnxruntime that gives frames in batches.

    Args:
        model: An `onnx.ModelProto`; its inputs have the batch size.
        frames: (N, H, W, 3) or (N, H, W) uint8 frames, (N, H, W, 4) of colour and depth. Those
            that do not fill a batch are left out. Fewer frames than one batch are repeated.
    """
    from onnxruntime.quantization import CalibrationDataReader

    names = [each.name for each in model.graph.input]
    batch = model.graph.input[0].type.tensor_type.shape.dim[0].dim_value
    count = max(len(frames) // batch, 1) * batch
    taken = frames[np.resize(np.arange(len(frames)), count)]
    batches: Iterable[UInt8] = taken.reshape(-1, batch, *frames.shape[1:])

    class Reader(CalibrationDataReader):  # type: ignore[misc]
        def __init__(self) -> None:
            self.waiting = iter(batches)

        def get_next(self) -> dict[str, UInt8] | None:
            images = next(self.waiting, None)
            if images is None:
                return None
            if len(names) == 1:
                return {names[0]: images}
            parts = (images[..., :3], images[..., 3])
            return dict(zip(names, map(np.ascontiguousarray, parts), strict=True))

    return Reader()
