"""Where the time of a network goes, and what it costs: from the profiles that onnxruntime writes.

A profile has the time of every operator that ran, its name, and the shapes of its inputs and
outputs. Multiply-adds are counted in a session without optimisation, in which every convolution and
matrix product is still the operator that the file contains.

The exporter names weights by the module that they come from, and nodes by their operator. A node
belongs to the part of its weights; one without weights belongs to the last of the parts that its
inputs come from, as the parts run one after another. Regions are pooled for the heads.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import prod
from pathlib import Path
from typing import Any, Final, NamedTuple

from numpy.typing import NDArray

from edgetree.model_file.graph_rules import GraphNode
from edgetree.model_file.safety_check import read_model_file
from edgetree.runtime.providers import PROVIDERS, SessionSettings, import_onnxruntime
from edgetree.runtime.session import OrtSession

PARTS: Final = ("trunk", "pyramid", "proposals", "heads")
"""The parts of a network in the order in which they run."""

_WEIGHTS: Final = {
    "model.backbone.": "trunk",
    "model.colour_backbone.": "trunk",
    "model.colour_lateral.": "pyramid",
    "model.blend": "pyramid",
    "model.pyramid.": "pyramid",
    "model.proposer.": "proposals",
    "model.box_head.": "heads",
    "model.mask_head.": "heads",
    "model.keypoint_head.": "heads",
}

_MOST_RUNS: Final = 5
_FEWEST: Final = 2  # the first one warms up
_LONGEST_S: Final = 4.0
_EVENT_SUFFIX: Final = "_kernel_time"

Event = Mapping[str, Any]
Inputs = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Operator:
    """The nodes of one operator on one provider.

    Attributes:
        operator: The operator, as it runs after optimisation.
        provider: What runs it, a name in `edgetree.runtime.PROVIDERS`.
        nodes: Number of its nodes.
        ms: Their time in one run.
    """

    operator: str
    provider: str
    nodes: int
    ms: float


class NetworkTimes(NamedTuple):
    """Where the time of one run of a network goes.

    Attributes:
        parts_ms: Time of each of `PARTS`.
        operators: The operators by descending time.
    """

    parts_ms: dict[str, float]
    operators: list[Operator]


def network_times(path: Path, settings: SessionSettings, inputs: Sequence[Inputs]) -> NetworkTimes:
    """Profile a network on inputs in turn, after one run to warm up; slow ones in fewer runs.

    Args:
        path: The model file.
        settings: How to run it.
        inputs: Inputs by name, at least one.
    """
    runs = _profile(path, settings, inputs, _MOST_RUNS + 1, optimised=True)[1:]
    events = [event for run in runs for event in run if event["args"]["op_name"] != "If"]
    parts = parts_of_nodes(read_model_file(path).nodes)
    parts_ms = dict.fromkeys(PARTS, 0.0)
    kinds: dict[tuple[str, str], list[float]] = {}
    part = PARTS[0]
    for event in events:
        ms = event["dur"] / 1000 / len(runs)
        part = _part_of(event["name"].removesuffix(_EVENT_SUFFIX), parts, part)
        parts_ms[part] += ms
        kinds.setdefault((event["args"]["op_name"], event["args"]["provider"]), []).append(ms)
    names = {provider.ort_name: provider.name for provider in PROVIDERS.values()}
    operators = [
        Operator(name, names.get(provider, provider), round(len(times) / len(runs)), sum(times))
        for (name, provider), times in kinds.items()
    ]
    return NetworkTimes(parts_ms, sorted(operators, key=lambda each: -each.ms))


def parts_of_nodes(nodes: Iterable[GraphNode]) -> dict[str, str]:
    """The part of each node, by the node's name and by the names of its outputs.

    onnxruntime names nodes that it makes of others by either.

    Args:
        nodes: The nodes of an exported graph, in the order of execution.
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


def _part_of(name: str, parts: Mapping[str, str], previous: str) -> str:
    """The part of a node after optimisation, which adds words to names and nodes of its own.

    A node of its own belongs to the part of the node that ran before it.
    """
    while name not in parts:
        shorter = max(name.rfind("_"), name.rfind("/"))
        if shorter <= 0:
            return previous
        name = name[:shorter]
    return parts[name]


def count_multiply_adds(path: Path, inputs: Inputs) -> int:
    """Count the multiply-adds of one run of a file, in convolutions and matrix products.

    Args:
        path: The model file.
        inputs: Inputs by name.
    """
    (events,) = _profile(path, SessionSettings(), [inputs], 1, optimised=False)
    return sum(_multiply_adds(event["args"]) for event in events)


def _multiply_adds(node: Event) -> int:
    """Multiply-adds of one node; 0 for nodes that are not products."""
    shapes: list[list[int]] = [next(iter(each.values())) for each in node["input_type_shape"]]
    made: list[list[int]] = [next(iter(each.values())) for each in node["output_type_shape"]]
    if node["op_name"] == "Conv":  # weights are (outputs, inputs of a group, height, width)
        return prod(made[0]) * prod(shapes[1][1:])
    if node["op_name"] in ("MatMul", "Gemm"):  # exports do not transpose the first factor
        return prod(made[0]) * shapes[0][-1]
    return 0


def _profile(
    path: Path, settings: SessionSettings, inputs: Sequence[Inputs], count: int, *, optimised: bool
) -> list[list[Event]]:
    """The events of the nodes in each of `count` runs, or of two once these take too long."""
    levels = import_onnxruntime().GraphOptimizationLevel

    with tempfile.TemporaryDirectory() as folder:

        def adjust(options: Any) -> None:
            options.enable_profiling = True
            options.profile_file_prefix = str(Path(folder) / "profile")
            if not optimised:
                options.graph_optimization_level = levels.ORT_DISABLE_ALL

        session = OrtSession(path, settings, adjust=adjust)
        start_s = time.perf_counter()
        runs = 0
        while runs < count and (runs < _FEWEST or time.perf_counter() - start_s < _LONGEST_S):
            session.run(inputs[runs % len(inputs)])
            runs += 1
        events = json.loads(session.end_profiling().read_text(encoding="utf-8"))
    nodes = [
        event
        for event in events
        if event.get("cat") == "Node" and event["name"].endswith(_EVENT_SUFFIX)
    ]
    # Of a combined file, runs differ in their nodes; the first one is in all of them, once.
    starts = [number for number, event in enumerate(nodes) if event["name"] == nodes[0]["name"]]
    if not nodes:
        return [[]] * runs
    return [nodes[start:end] for start, end in pairwise((*starts, len(nodes)))]
