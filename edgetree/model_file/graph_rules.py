"""What the graph of a model file may contain: the operators and sizes that exports have.

onnxruntime computes parts of a graph that depend on constants alone while it opens the file. A file
of a few bytes could so ask for any amount of memory and time. The exports of this project have few
such parts, and none that make anything large.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

MAX_ELEMENTS: Final = 2**28  # of one tensor
_MAX_ENLARGED: Final = 2**26  # elements that constants are expanded to, in sum
_MAX_COMPUTED: Final = 2  # elements that are computed from constants, for each in the file
_MAX_EXPANDED: Final = 64
# The time to open a file grows with the square of these; exports have 600 to 2,000, and combined
# files 3,200.
_MAX_NODES: Final = 5_000
_MAX_CONSTANTS: Final = 10_000
_MAX_ATTRIBUTE: Final = 1024
_MAX_PADDING: Final = 1024
_MAX_ENLARGEMENT: Final = 64.0

# The operators of all backbones, precisions and operator sets, Identity, and If of combined files.
OPERATORS: Final = frozenset(
    (
        *("Abs", "Add", "And", "ArgMax", "AveragePool", "Cast", "Ceil", "Clip", "Concat", "Conv"),
        *("CumSum", "DepthToSpace", "DequantizeLinear", "Div", "Equal", "Exp", "Expand"),
        *("Flatten", "Floor", "Gather", "GatherElements", "GatherND", "Gemm", "GlobalAveragePool"),
        *("Greater", "GreaterOrEqual", "HardSigmoid", "HardSwish", "Identity", "If", "Less"),
        *("LessOrEqual", "Log", "MatMul", "Max", "MaxPool", "Min", "Mul", "Neg"),
        *("NonMaxSuppression", "NonZero", "Not", "Or", "Pad", "QuantizeLinear", "Reciprocal"),
        *("ReduceMax", "ReduceMean", "ReduceMin", "ReduceProd", "ReduceSum", "Relu", "Reshape"),
        *("Resize", "RoiAlign", "Round", "ScatterND", "Shape", "Sigmoid", "Slice", "Softmax"),
        *("Sqrt", "Squeeze", "Sub", "TopK", "Transpose", "Unsqueeze", "Where"),
    )
)
# Those that exports apply to constants alone. None of them but Expand makes its input larger.
_ON_CONSTANTS: Final = frozenset(("Cast", "DequantizeLinear", "Expand", "Identity", "Shape"))
_KEEPING_VALUES: Final = frozenset(("Cast", "Identity"))
_BOUNDED_ATTRIBUTES: Final = frozenset(("blocksize", "output_height", "output_width", "pads"))


class RuleBroken(Exception):
    """The graph is not like those of exports; the message says what it contains."""


class Constant(NamedTuple):
    """A constant of the graph.

    Attributes:
        elements: Number of its elements.
        values: Its values if they are few numbers, else None.
    """

    elements: int
    values: tuple[float, ...] | None


@dataclass
class GraphNode:
    """One node of the graph.

    Attributes:
        operators: Its operator; several only in files that no exporter writes.
        domains: Domain of the operator, likewise; none for ONNX's own operators.
        names: Its name, likewise; none if it has no name.
        inputs: Names of its inputs, "" for those left out.
        outputs: Names of its outputs.
        integers: Whole numbers of its attributes by name.
    """

    operators: list[str] = field(default_factory=list)
    domains: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    integers: dict[str, list[int]] = field(default_factory=dict)


def check_graph(
    nodes: Iterable[GraphNode],
    inputs: Mapping[str, tuple[int | str, ...]],
    constants: Mapping[str, Constant],
) -> None:
    """Check the nodes of a graph, in their order.

    Args:
        nodes: The nodes.
        inputs: Shapes of the graph's inputs by name; dynamic sizes are given by their name.
        constants: The graph's constants by name.

    Raises:
        RuleBroken: The graph has an operator that exports do not have, computes something else from
            constants alone than exports do, or enlarges a tensor by more than exports would.
    """
    if len(constants) > _MAX_CONSTANTS:
        raise RuleBroken(f"has more than {_MAX_CONSTANTS} constants: expected fewer")
    checker = _Checker(inputs, constants)
    for index, node in enumerate(nodes):
        if index >= _MAX_NODES:
            raise RuleBroken(f"has more than {_MAX_NODES} operators: expected fewer")
        checker.check(node)


class _Checker:
    def __init__(
        self, inputs: Mapping[str, tuple[int | str, ...]], constants: Mapping[str, Constant]
    ) -> None:
        self._constants = dict(constants)
        self._made = {"", *inputs, *constants}
        self._elements = {name: _known_elements(shape) for name, shape in inputs.items()}
        self._shapes: dict[str, int] = {}  # outputs of Shape: elements that are known to be there
        self._expanded: set[str] = set()  # constants of the size of another tensor
        self._most_computed = _MAX_COMPUTED * sum(each.elements for each in constants.values())
        self._computed = self._enlarged = 0

    def check(self, node: GraphNode) -> None:
        """Check one node, and note which of its outputs are constant."""
        operator = self._operator(node)
        early = [name for name in node.inputs if name not in self._made]
        if early:
            raise RuleBroken(
                f"uses {early[0][:100]!r} before it is computed: expected operators in the order of"
                " execution"
            )
        again = [name for name in node.outputs if name and name in self._made]
        if again:  # names of one branch must not stand for those of another
            raise RuleBroken(f"computes {again[0][:100]!r} twice: expected unique names")
        self._made.update(node.outputs)
        for name, values in node.integers.items():
            if name in _BOUNDED_ATTRIBUTES and max(values, default=0) > _MAX_ATTRIBUTE:
                raise RuleBroken(
                    f"has an operator {operator} with {name} of {max(values)}:"
                    f" expected at most {_MAX_ATTRIBUTE}"
                )
        self._check_growth(operator, node)
        if operator == "Shape":
            known = max((self._elements.get(name, 1) for name in node.inputs), default=1)
            self._shapes |= dict.fromkeys(node.outputs, known)
        elif all(self._is_constant(name) for name in node.inputs):
            self._compute(operator, node)

    def _is_constant(self, name: str) -> bool:
        return not name or any(
            name in known for known in (self._constants, self._shapes, self._expanded)
        )

    def _compute(self, operator: str, node: GraphNode) -> None:
        """Check and note what onnxruntime computes while it opens the file."""
        source = self._constants.get(node.inputs[0]) if node.inputs else None
        if operator not in _ON_CONSTANTS or source is None:
            raise RuleBroken(
                f"computes {operator} from constants alone: expected the result as a constant"
            )
        if operator == "Expand":
            self._expand(source.elements, node)
            return
        elements = source.elements
        self._computed += elements
        if self._computed > self._most_computed:
            raise RuleBroken(
                f"computes {self._computed} numbers from constants: expected at most"
                f" {self._most_computed}, {_MAX_COMPUTED} for each in the file"
            )
        values = source.values if operator in _KEEPING_VALUES else None
        for name in node.outputs:
            self._constants[name] = Constant(elements, values)

    def _expand(self, elements: int, node: GraphNode) -> None:
        """Check and note a constant that is expanded."""
        shapes = [self._shapes[name] for name in node.inputs if name in self._shapes]
        sizes = shapes or [int(abs(size)) for size in self._values("Expand", node, 1)]
        elements *= math.prod(sizes)
        self._enlarged += elements
        self._limit("Expand", self._enlarged, _MAX_ENLARGED)
        if not shapes:
            self._constants |= dict.fromkeys(node.outputs, Constant(elements, None))
            return
        self._expanded |= set(node.outputs)
        if len(self._expanded) > _MAX_EXPANDED:
            raise RuleBroken(f"expands more than {_MAX_EXPANDED} constants: expected the results")

    def _operator(self, node: GraphNode) -> str:
        """The operator of a node, if it is one of `OPERATORS`."""
        foreign = [domain for domain in node.domains if domain not in ("", "ai.onnx")]
        unknown = [name for name in node.operators if name not in OPERATORS]
        if unknown or foreign or len(node.operators) != 1:
            of_domain = f" of {foreign[0][:100]!r}" if foreign else ""
            name = (unknown or node.operators or ["without a name"])[0][:100]
            raise RuleBroken(
                f"contains an operator {name}{of_domain}: expected only those of `edgetree export`"
            )
        return node.operators[0]

    def _check_growth(self, operator: str, node: GraphNode) -> None:
        """Check the sizes that a node gives to its output; they must be constants."""
        if operator in ("Expand", "Reshape"):
            sizes = self._values(operator, node, 1)
            self._limit(operator, math.prod(abs(size) or 1 for size in sizes), MAX_ELEMENTS)
            known = math.prod(max(int(size), 1) for size in sizes)
            self._elements |= dict.fromkeys(node.outputs, known)
        elif operator == "Pad":
            padding = self._values(operator, node, 1)
            self._limit(operator, max(map(abs, padding), default=0), _MAX_PADDING)
        elif operator == "Resize":
            scales, sizes = self._values(operator, node, 2), self._values(operator, node, 3)
            self._limit(operator, math.prod(max(scale, 1.0) for scale in scales), _MAX_ENLARGEMENT)
            self._limit(operator, math.prod(abs(size) or 1 for size in sizes), MAX_ELEMENTS)

    def _values(self, operator: str, node: GraphNode, position: int) -> tuple[float, ...]:
        """The values of a constant input; none if it is left out or the shape of a tensor."""
        name = node.inputs[position] if position < len(node.inputs) else ""
        if not name or name in self._shapes:
            return ()
        constant = self._constants.get(name)
        if constant is None or not all(map(math.isfinite, constant.values or (math.nan,))):
            raise RuleBroken(
                f"has an operator {operator} whose sizes are computed: expected constants"
            )
        return constant.values or ()

    def _limit(self, operator: str, found: float, largest: float) -> None:
        if not found <= largest:
            raise RuleBroken(
                f"has an operator {operator} that enlarges its input to or by {found:g}:"
                f" expected at most {largest:g}"
            )


def _known_elements(shape: tuple[int | str, ...]) -> int:
    """Number of elements of a shape, with 1 for the sizes that are not known."""
    return math.prod(size for size in shape if isinstance(size, int))
