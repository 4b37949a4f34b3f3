"""Which part of the network each node of a file belongs to.

The exporter names weights by the module that they come from, and nodes by their operator. A node
belongs to the part of its weights; one without weights belongs to the last of the parts that its
inputs come from, as the parts run one after another. Regions are pooled for the heads.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from edgetree.model_file.graph_rules import GraphNode

PARTS: Final = ("trunk", "pyramid", "proposals", "heads")
"""The parts of a network in the order in which they run."""

_WEIGHTS: Final = {
    "model.backbone.": "trunk",
    "model.pyramid.": "pyramid",
    "model.proposer.": "proposals",
    "model.box_head.": "heads",
    "model.mask_head.": "heads",
    "model.keypoint_head.": "heads",
}


def parts_of_nodes(nodes: Iterable[GraphNode]) -> dict[str, str]:
    """The part of each node, by the node's name and by the names of its outputs.

    onnxruntime names nodes that it makes of others by either.

    Args:
        nodes: the nodes of an exported graph, in the order of execution.
    """
    made: dict[str, int] = {}
    found: dict[str, str] = {}
    for node in nodes:
        places = [made.get(name, _place_of_weight(name)) for name in node.inputs]
        if node.operators == ["RoiAlign"]:
            places.append(PARTS.index("heads"))
        place = max(places, default=0)
        made |= dict.fromkeys(node.outputs, place)
        found |= dict.fromkeys((*node.names, *node.outputs), PARTS[place])
    return found


def _place_of_weight(name: str) -> int:
    for prefix, part in _WEIGHTS.items():
        if name.startswith(prefix):
            return PARTS.index(part)
    return 0
