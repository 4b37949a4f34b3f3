"""Damaged and malicious model files are rejected before onnxruntime opens them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edgetree.errors import ModelFileError
from edgetree.model_file.inputs_outputs import standard_outputs
from edgetree.model_file.manifest import Manifest
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.model_file.safety_check import Shape, read_model_file
from edgetree.runtime import TreeDetector, default_model

ModelWriter = Callable[..., Path]


def _part(field: int, content: bytes) -> bytes:
    """A protobuf field with bytes as its value."""
    head, size = bytearray([field << 3 | 2]), len(content)
    while size > 0x7F:
        head.append(size & 0x7F | 0x80)
        size >>= 7
    return bytes([*head, size]) + content


def test_dynamic_sizes_are_read_by_their_names(
    rgb_manifest: Manifest, write_model: ModelWriter
) -> None:
    found = read_model_file(write_model(rgb_manifest))
    assert found.input_shapes == {"image": ("batch", 384, 640, 3)}


@pytest.mark.parametrize(
    "tensor",
    [b"\x70\x81\x80\x80\x80\x10", b"\xf0\x80\x80\x80\x10\x01"],
    ids=["location of 33 bits", "field number of 33 bits"],
)
def test_numbers_of_more_than_32_bits_hide_no_external_data(tensor: bytes, tmp_path: Path) -> None:
    path = tmp_path / "trees.onnx"
    path.write_bytes(_part(7, _part(5, tensor)))
    with pytest.raises(ModelFileError, match="stores weights in another file"):
        read_model_file(path)


def test_a_size_that_is_no_number_is_refused(tmp_path: Path) -> None:
    size = _part(1, b"\x0a\x00")  # a size as an empty text
    graph_input = _part(1, b"x") + _part(2, _part(1, _part(2, size)))
    path = tmp_path / "trees.onnx"
    path.write_bytes(_part(7, _part(11, graph_input)))
    with pytest.raises(ModelFileError, match="is not an ONNX model"):
        read_model_file(path)


def test_a_file_of_very_many_fields_is_rejected_quickly(tmp_path: Path) -> None:
    path = tmp_path / "trees.onnx"
    path.write_bytes(b"\x08\x01" * 1_000_001)
    with pytest.raises(ModelFileError, match="more than 1000000 fields"):
        read_model_file(path)


def test_deeply_nested_graphs_are_refused(tmp_path: Path) -> None:
    graph = _part(5, b"\x70\x01")  # weights in another file
    for _ in range(3000):  # more than Python's recursion limit
        graph = _part(1, _part(5, _part(6, graph)))
    path = tmp_path / "trees.onnx"
    path.write_bytes(_part(7, graph))
    with pytest.raises(ModelFileError, match="contains a graph inside an operator"):
        read_model_file(path)


@pytest.mark.parametrize("share", [0.001, 0.3, 0.9, 0.9999])
def test_a_truncated_file_is_rejected(share: float, tmp_path: Path) -> None:
    content = default_model("depth").read_bytes()
    path = tmp_path / "trees.onnx"
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(ModelFileError, match=r"trees\.onnx is not an ONNX model .*truncated"):
        read_model_file(path)


@st.composite
def _damage(draw: st.DrawFn, whole: bytes) -> bytes:
    """A file cut short, with bits turned over, or with bytes replaced, put in or taken out."""
    content = bytearray(whole)
    positions = st.integers(0, len(whole) - 1)
    how = draw(st.sampled_from(["cut short", "bits", "bytes"]))
    if how == "cut short":
        del content[draw(positions) :]
    elif how == "bits":
        for position in draw(st.lists(positions, min_size=1, max_size=16)):
            content[position] ^= 1 << draw(st.integers(0, 7))
    else:
        for _ in range(draw(st.integers(1, 3))):
            position = min(draw(positions), len(content))
            content[position : position + draw(st.integers(0, 4))] = draw(st.binary(max_size=6))
    return bytes(content)


@pytest.fixture(scope="module")
def small_file() -> bytes:
    """A valid file of a few hundred bytes with a constant, two inputs, an output and metadata."""
    return onnx_bytes(
        [Node("MatMul", ("x", "weights"), ("y",)), Node("Identity", ("z",), ("unused",))],
        inputs={"x": TensorType("float32", ("batch", 4)), "z": TensorType("uint8", (2, 3))},
        outputs={"y": TensorType("float32", ("batch", 3))},
        constants={"weights": np.ones((4, 3), np.float32)},
        metadata={"name": "small", "more": "\u00e9\u2013"},
    )


def _check_read_or_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    message = ""
    shapes: list[Shape] = []
    try:
        found = read_model_file(path)
        shapes = [*found.input_shapes.values(), *found.output_shapes.values()]
    except ModelFileError as error:
        message = str(error)
    assert message.startswith(f"model {path} " if message else "")
    assert "\n" not in message
    assert all(size >= 1 for shape in shapes for size in shape if isinstance(size, int))


def test_a_file_with_one_bit_turned_over_is_read_or_refused(
    small_file: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "trees.onnx"
    path.write_bytes(small_file)
    assert read_model_file(path).input_shapes == {"x": ("batch", 4), "z": (2, 3)}
    for position in range(len(small_file)):
        for bit in (1, 2, 7):  # of a field's kind, of the small sizes, of how long a number is
            content = bytearray(small_file)
            content[position] ^= 1 << bit
            _check_read_or_refused(path, bytes(content))


@settings(max_examples=200)
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused(
    small_file: bytes, tmp_path: Path, data: st.DataObject
) -> None:
    _check_read_or_refused(tmp_path / "trees.onnx", data.draw(_damage(small_file)))


@settings(max_examples=200)
@given(data=st.data())
def test_damage_raises_nothing_but_model_file_errors(
    rgb_manifest: Manifest, write_model: ModelWriter, tmp_path: Path, data: st.DataObject
) -> None:
    few = dataclasses.replace(rgb_manifest, outputs=standard_outputs(2, masks=False))
    content = write_model(few).read_bytes()
    path = tmp_path / "damaged.onnx"
    path.write_bytes(data.draw(_damage(content)))
    message = ""
    try:
        TreeDetector.load(path, threads=1).detect(np.zeros((40, 64, 3), np.uint8))
    except ModelFileError as error:
        message = str(error)
    assert "\n" not in message
