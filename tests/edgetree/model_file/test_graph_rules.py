"""Model files that would compute too much are rejected before onnxruntime opens them."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edgetree.errors import ModelFileError
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.model_file.safety_check import read_model_file
from edgetree.runtime.session import OrtSession

FLOAT = TensorType("float32", (1, 8))
BILLIONS = np.array([40_000, 40_000], np.int64)
ONE = np.ones(1, np.float32)


def file_of(folder: Path, nodes: list[Node], **constants: np.ndarray) -> Path:
    path = folder / "trees.onnx"
    path.write_bytes(
        onnx_bytes(nodes, inputs={"x": FLOAT}, outputs={"y": FLOAT}, constants=constants)
    )
    return path


REFUSED: dict[str, tuple[list[Node], dict[str, np.ndarray], str]] = {
    "an operator that makes constants": (
        [Node("ConstantOfShape", ("n",), ("y",))],
        {"n": BILLIONS},
        "contains an operator ConstantOfShape: expected only those of `edgetree export`",
    ),
    "a range": (
        [Node("Range", ("n", "n", "n"), ("y",))],
        {"n": BILLIONS[:1]},
        "contains an operator Range",
    ),
    "random numbers": ([Node("RandomNormalLike", ("x",), ("y",))], {}, "operator RandomNormalLike"),
    "an expanded constant": (
        [Node("Expand", ("one", "n"), ("y",))],
        {"one": ONE, "n": BILLIONS},
        "an operator Expand that enlarges its input to or by 1.6e+09: expected at most 2.68",
    ),
    "an expanded input": ([Node("Expand", ("x", "n"), ("y",))], {"n": BILLIONS}, "operator Expand"),
    "a size that another operator computes": (
        [Node("Add", ("n", "x"), ("m",)), Node("Expand", ("x", "m"), ("y",))],
        {"n": BILLIONS},
        "an operator Expand whose sizes are computed: expected constants",
    ),
    "an operator on constants": (
        [Node("MatMul", ("c", "r"), ("y",))],
        {"c": np.ones((9, 1), np.float32), "r": np.ones((1, 9), np.float32)},
        "computes MatMul from constants alone: expected the result as a constant",
    ),
    "an operator on an expanded constant": (
        [
            Node("Shape", ("x",), ("s",)),
            Node("Expand", ("one", "s"), ("e",)),
            Node("Cast", ("e",), ("y",)),
        ],
        {"one": ONE},
        "computes Cast from constants alone",
    ),
    "many expanded constants": (
        [Node("Shape", ("x",), ("s",))]
        + [Node("Expand", ("one", "s"), (f"e{number}",)) for number in range(65)],
        {"one": ONE},
        "expands more than 64 constants",
    ),
    "many large constants": (
        [Node("Expand", ("one", "n"), (f"e{number}",)) for number in range(5)],
        {"one": ONE, "n": np.array([2**12, 2**12], np.int64)},
        "operator Expand that enlarges its input to or by 8.38861e+07: expected at most 6.71",
    ),
    "constants that are copied again and again": (
        [Node("Identity", (f"c{number}",), (f"c{number + 1}",)) for number in range(3)],
        {"c0": np.ones(2**16, np.float32)},
        "computes 196608 numbers from constants: expected at most 131072, 2 for each in the file",
    ),
    "operators in another order": (
        [Node("MatMul", ("a", "a"), ("y",)), Node("Identity", ("one",), ("a",))],
        {"one": ONE},
        "uses 'a' before it is computed",
    ),
    "an enlarged image": (
        [Node("Resize", ("x", "", "n"), ("y",))],
        {"n": np.array([1000.0, 1000.0], np.float32)},
        "an operator Resize that enlarges",
    ),
    "a wide border": (
        [Node("Pad", ("x", "n"), ("y",))],
        {"n": np.array([0, 10**9, 0, 0], np.int64)},
        "an operator Pad that enlarges",
    ),
    "sizes that are no numbers": (
        [Node("Resize", ("x", "", "n"), ("y",))],
        {"n": np.array([np.inf, np.nan], np.float32)},
        "an operator Resize whose sizes are computed",
    ),
    "very many operators": (
        [Node("Identity", ("x",), (f"y{number}",)) for number in range(5_001)],
        {},
        "has more than 5000 operators",
    ),
    "very many constants": (
        [Node("Identity", ("x",), ("y",))],
        {f"c{number}": ONE for number in range(10_001)},
        "has more than 10000 constants",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_graphs_that_no_export_has_are_refused(name: str, tmp_path: Path) -> None:
    nodes, constants, message = REFUSED[name]
    with pytest.raises(ModelFileError) as caught:
        OrtSession(file_of(tmp_path, nodes, **constants))
    assert str(caught.value).startswith(f"model {tmp_path / 'trees.onnx'} ")
    assert message in str(caught.value)


onnx = pytest.importorskip("onnx")
helper, TensorProto = onnx.helper, onnx.TensorProto
VALUE = helper.make_tensor_value_info


def _loop() -> Any:
    """A graph that counts to 2**60."""
    inner = helper.make_graph(
        [helper.make_node("Identity", ["c"], ["d"]), helper.make_node("Identity", ["v"], ["w"])],
        "inner",
        [
            VALUE("i", TensorProto.INT64, []),
            VALUE("c", TensorProto.BOOL, []),
            VALUE("v", TensorProto.FLOAT, [1, 8]),
        ],
        [VALUE("d", TensorProto.BOOL, []), VALUE("w", TensorProto.FLOAT, [1, 8])],
    )
    return [helper.make_node("Loop", ["n", "", "x"], ["y"], body=inner)], {}


def _if(nodes: list[Any], made: str = "y", condition: str = "c", inputs: Any = ()) -> Any:
    """An If with these nodes in one branch, and a copy of "x" in the other."""
    own, copied = (VALUE(name, TensorProto.FLOAT, [1, 8]) for name in ("z", f"other_{made}"))
    branch = helper.make_graph(nodes, "branch", list(inputs), [own])
    copy = helper.make_node("Identity", ["x"], [copied.name])
    other = helper.make_graph([copy], "other", [], [copied])
    return helper.make_node("If", [condition], [made], then_branch=branch, else_branch=other)


def _condition() -> Any:
    return helper.make_node("Equal", ["x", "x"], ["c"])


def _deep_branches() -> Any:
    node = helper.make_node("Identity", ["x"], ["z"])
    for level in range(3):
        node = _if([node], f"y{level}")
    return [_condition(), node], {}


def _sizes_of_the_other_branch() -> Any:
    """A name that is a shape in one branch, and computed in the other."""
    shape = helper.make_node("Shape", ["x"], ["s"])
    one = helper.make_graph([shape], "one", [], [VALUE("s", TensorProto.INT64, [2])])
    nodes = [
        helper.make_node("Cast", ["x"], ["s"], to=TensorProto.INT64),
        helper.make_node("Expand", ["x", "s"], ["w"]),
    ]
    two = helper.make_graph(nodes, "two", [], [VALUE("w", TensorProto.FLOAT, [8])])
    node = helper.make_node("If", ["c"], ["y"], else_branch=one, then_branch=two)
    return [_condition(), node], {}


def _branch_with_inputs() -> Any:
    copy = helper.make_node("Identity", ["i"], ["z"])
    return [_condition(), _if([copy], inputs=[VALUE("i", TensorProto.FLOAT, [1, 8])])], {}


def _loop_in_a_branch() -> Any:
    (loop,), _ = _loop()
    return [_condition(), _if([loop])], {}


def _large_constant_in_a_branch() -> Any:
    size = helper.make_tensor("size", TensorProto.INT64, [1], struct.pack("<q", 2**40), raw=True)
    branch = helper.make_graph(
        [helper.make_node("Expand", ["x", "size"], ["z"])],
        "branch",
        [],
        [VALUE("z", TensorProto.FLOAT, [1, 8])],
        initializer=[size],
    )
    empty = helper.make_graph([helper.make_node("Identity", ["x"], ["z2"])], "other", [], [])
    node = helper.make_node("If", ["c"], ["z"], then_branch=branch, else_branch=empty)
    return [_condition(), node], {}


def _branches_of_a_constant() -> Any:
    return [_if([helper.make_node("Identity", ["x"], ["z"])], condition="n")], {}


def test_branches_of_if_are_opened(tmp_path: Path) -> None:
    """Nodes of branches stand before the If, so that its outputs are made after them."""
    inner = _if([helper.make_node("Identity", ["x"], ["z"])], "inner")
    nodes = [_condition(), _if([inner], "outer"), helper.make_node("Abs", ["outer"], ["y"])]
    ends = [VALUE("x", TensorProto.FLOAT, [1, 8])], [VALUE("y", TensorProto.FLOAT, [1, 8])]
    path = tmp_path / "trees.onnx"
    path.write_bytes(
        helper.make_model(helper.make_graph(nodes, "graph", *ends)).SerializeToString()
    )
    found = [node.operators[0] for node in read_model_file(path).nodes]
    assert found == ["Equal", *["Identity"] * 3, "If", "If", "Abs"]


def _functions() -> Any:
    """Functions of which each calls the one before nine times."""
    opset = [helper.make_opsetid("", 20), helper.make_opsetid("bomb", 1)]
    functions = []
    for level in range(20):
        operator, domain = (f"f{level - 1}", "bomb") if level else ("Identity", "")
        calls = [helper.make_node(operator, ["x"], [f"y{i}"], domain=domain) for i in range(9)]
        functions.append(helper.make_function("bomb", f"f{level}", ["x"], ["y8"], calls, opset))
    return [helper.make_node("f19", ["x"], ["y"], domain="bomb")], {"functions": functions}


def _foreign_domain() -> Any:
    return [helper.make_node("Gelu", ["x"], ["y"], domain="com.microsoft")], {}


def _large_output() -> Any:
    node = helper.make_node("RoiAlign", ["x", "x", "x"], ["y"], output_height=10**6)
    return [node], {}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (_loop, "contains a graph inside an operator: expected none but the branches of If"),
        (_sizes_of_the_other_branch, "computes 's' twice: expected unique names"),
        (_deep_branches, "contains a graph inside an operator: expected none but the branches of"),
        (_branch_with_inputs, "has an If whose branch has inputs: expected none"),
        (_loop_in_a_branch, "contains a graph inside an operator: expected none but the branches"),
        (_large_constant_in_a_branch, "enlarges its input"),
        (_branches_of_a_constant, "computes If from constants alone"),
        (_functions, "contains functions or a training graph"),
        (_foreign_domain, "contains an operator Gelu of 'com.microsoft'"),
        (_large_output, "RoiAlign with output_height of 1000000: expected at most 1024"),
    ],
)
def test_loops_functions_and_large_attributes_are_refused(
    make: Callable[[], Any], message: str, tmp_path: Path
) -> None:
    nodes, more = make()
    ends = [VALUE("x", TensorProto.FLOAT, [1, 8])], [VALUE("y", TensorProto.FLOAT, [1, 8])]
    count = helper.make_tensor("n", TensorProto.INT64, [], [2**60])
    graph = helper.make_graph(nodes, "graph", *ends, initializer=[count])
    path = tmp_path / "trees.onnx"
    path.write_bytes(helper.make_model(graph, **more).SerializeToString())
    with pytest.raises(ModelFileError) as caught:
        read_model_file(path)
    assert message in str(caught.value)
