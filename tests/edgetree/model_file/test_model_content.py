"""Model files with external or missing data are rejected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edgetree.errors import ModelFileError
from edgetree.model_file.safety_check import read_model_file
from edgetree.runtime import TreeDetector, default_model

onnx = pytest.importorskip("onnx")
TensorProto, helper, numpy_helper = onnx.TensorProto, onnx.helper, onnx.numpy_helper


def _model(**parts: Any) -> Any:
    """A valid model; `parts` are further fields of the graph, such as `initializer`."""
    size = [1, 8]
    graph = helper.make_graph(
        parts.pop("nodes", [helper.make_node("Identity", ["x"], ["y"])]),
        "graph",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, parts.pop("x_size", size))],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, size)],
        **parts,
    )
    return helper.make_model(graph)


def _save(model: Any, folder: Path) -> Path:
    path = folder / "trees.onnx"
    path.write_bytes(model.SerializeToString())
    return path


def _outside(location: str = "../../secret.bin") -> Any:
    tensor = numpy_helper.from_array(np.zeros(4, np.float32), "weights")
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value=location)
    return tensor


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_metadata_and_shapes_are_as_the_onnx_package_reads_them(modality: str) -> None:
    path = default_model(modality)
    found, model = read_model_file(path), onnx.load(path)
    assert found.metadata == {item.key: item.value for item in model.metadata_props}
    for shapes, items in (
        (found.input_shapes, model.graph.input),
        (found.output_shapes, model.graph.output),
    ):
        assert shapes == {
            item.name: tuple(dim.dim_value for dim in item.type.tensor_type.shape.dim)
            for item in items
        }


def _in_an_attribute(tensor: Any) -> Any:
    return _model(nodes=[helper.make_node("Constant", [], ["y"], value=tensor)])


def _in_a_branch(tensor: Any) -> Any:
    inner = helper.make_graph(
        [helper.make_node("Constant", [], ["z"], value=tensor)],
        "inner",
        [],
        [helper.make_tensor_value_info("z", TensorProto.FLOAT, [4])],
    )
    middle = helper.make_graph(
        [helper.make_node("If", ["c"], ["z"], then_branch=inner, else_branch=inner)],
        "middle",
        [],
        [helper.make_tensor_value_info("z", TensorProto.FLOAT, [4])],
    )
    node = helper.make_node("If", ["c"], ["y"], then_branch=middle, else_branch=middle)
    return _model(nodes=[node])


def _in_a_function(tensor: Any) -> Any:
    model = _model()
    node = helper.make_node("Constant", [], ["y"], value=tensor)
    made = helper.make_function("own", "f", [], ["y"], [node], [helper.make_opsetid("", 18)])
    model.functions.append(made)
    return model


def _in_training(tensor: Any) -> Any:
    model = _model()
    model.training_info.add().initialization.CopyFrom(_in_an_attribute(tensor).graph)
    return model


@pytest.mark.parametrize(
    ("model", "what"),
    [
        (_model(initializer=[_outside()]), "stores weights in another file"),
        (_model(initializer=[_outside("*/_ORT_MEM_ADDR_/*")]), "stores weights in another file"),
        (_in_an_attribute(_outside()), "stores weights in another file"),
        (_in_a_branch(_outside()), "stores weights in another file"),
        (_in_a_function(_outside()), "contains functions or a training graph"),
        (_in_training(_outside()), "contains functions or a training graph"),
    ],
    ids=["weights", "memory", "attribute", "branch", "function", "training"],
)
def test_weights_in_another_file_are_rejected(model: Any, what: str, tmp_path: Path) -> None:
    path = _save(model, tmp_path)
    expected = rf"trees\.onnx {what}: expected"
    with pytest.raises(ModelFileError, match=expected):
        read_model_file(path)
    with pytest.raises(ModelFileError, match=expected):
        TreeDetector.load(path)


def test_sparse_weights_and_compiled_parts_are_rejected(tmp_path: Path) -> None:
    values = numpy_helper.from_array(np.ones(1, np.float32), "s")
    indices = numpy_helper.from_array(np.zeros(1, np.int64))
    sparse = helper.make_sparse_tensor(values, indices, [10**6, 10**6])
    with pytest.raises(
        ModelFileError, match=r"trees\.onnx contains a sparse tensor: expected dense"
    ):
        read_model_file(_save(_model(sparse_initializer=[sparse]), tmp_path))
    node = helper.make_node("EPContext", ["x"], ["y"], domain="com.microsoft", embed_mode=0)
    with pytest.raises(ModelFileError, match="contains an operator EPContext"):
        read_model_file(_save(_model(nodes=[node]), tmp_path))


@pytest.mark.parametrize("dims", [[10**6, 10**6], [2**40] * 2000, [-5], [5]])
def test_a_tensor_with_missing_data_is_rejected(dims: list[int], tmp_path: Path) -> None:
    tensor = TensorProto(name="weights", data_type=TensorProto.FLOAT, dims=dims)
    if dims == [5]:
        tensor.raw_data = bytes(20)
        read_model_file(_save(_model(initializer=[tensor]), tmp_path))
        return
    with pytest.raises(ModelFileError, match=r"trees\.onnx declares (its|a) tensor .*: expected"):
        read_model_file(_save(_model(initializer=[tensor]), tmp_path))


@pytest.mark.parametrize("size", [[10**6, 10**6], ["n", 2**40], [0, 8], [-1, 8]])
def test_an_input_of_invalid_size_is_rejected(size: list[int | str], tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match=r"trees\.onnx declares 'x' as .*: expected sizes"):
        read_model_file(_save(_model(x_size=size), tmp_path))
