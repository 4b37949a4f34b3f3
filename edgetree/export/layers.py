"""Which nodes of a traced graph are which part of the network, and frames to watch them on."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["LAST_LAYERS", "frame_reader", "last_products", "network_nodes", "scopes_of"]

_SCOPES: Final = "pkg.torch.onnx.name_scopes"
# Their outputs are read as coordinates and probabilities: rounding shows directly in the results.
LAST_LAYERS: Final = (
    "model.proposer.objectness",
    "model.proposer.shift",
    "model.box_head.score",
    "model.box_head.shift",
    "model.mask_head.score",
    "model.keypoint_head.tower.up",
)


def scopes_of(node: Any) -> list[str]:
    """The modules that a node comes from, outermost first."""
    for entry in node.metadata_props:
        if entry.key == _SCOPES:
            return [str(scope) for scope in ast.literal_eval(entry.value)]
    return []


def network_nodes(model: Any) -> list[Any]:
    """Nodes of the network proper but for its last layers; the rest is arithmetic on boxes."""
    chosen = []
    for node in model.graph.node:
        scopes = scopes_of(node)
        inside = any(scope.startswith("model.") for scope in scopes)
        last = any(scope in LAST_LAYERS for scope in scopes)
        bilinear = node.op_type == "Resize" and "model.keypoint_head" in scopes
        if inside and not last and not bilinear:
            chosen.append(node)
    return chosen


def last_products(model: Any) -> list[Any]:
    """The last layers' products of matrices."""
    return [
        node
        for node in model.graph.node
        if node.op_type == "MatMul" and any(s in LAST_LAYERS for s in scopes_of(node))
    ]


def frame_reader(model: Any, frames: NDArray[np.uint8]) -> Any:
    """Frames (N, H, W, 3) or (N, H, W) in the model's batches, as onnxruntime's tools read them.

    As many as fill the batches are taken; the first ones again if there are fewer than one.
    """
    from onnxruntime.quantization import CalibrationDataReader

    name = model.graph.input[0].name
    batch = model.graph.input[0].type.tensor_type.shape.dim[0].dim_value
    count = max(len(frames) // batch, 1) * batch
    taken = frames[np.resize(np.arange(len(frames)), count)]
    batches: Iterable[NDArray[np.uint8]] = taken.reshape(-1, batch, *frames.shape[1:])

    class Reader(CalibrationDataReader):  # type: ignore[misc]
        def __init__(self) -> None:
            self.waiting = iter(batches)

        def get_next(self) -> dict[str, NDArray[np.uint8]] | None:
            images = next(self.waiting, None)
            return None if images is None else {name: images}

    return Reader()
