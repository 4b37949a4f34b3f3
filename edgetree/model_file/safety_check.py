"""Check a model file before onnxruntime opens it.

Models of this project are single, self-contained ONNX files. In general an ONNX model may refer to
other files, declare tensors whose data are missing, be truncated, or compute anything while it is
opened; opening it would then read those files, or take any amount of memory and time. This module
parses the structure of the file once, without reading the weights, and rejects such models. What
the graph may contain is in `edgetree.model_file.graph_rules`.

ONNX files are protobuf messages. A message is a sequence of fields, each with a number, a wire type
and a value. See https://protobuf.dev/programming-guides/encoding for the encoding, and onnx.proto
for the field names in the comments.
"""

from __future__ import annotations

import math
import mmap
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeAlias

from basetree.files.regular import open_regular
from edgetree.errors import ModelFileError
from edgetree.model_file.graph_rules import (
    MAX_ELEMENTS,
    Constant,
    GraphNode,
    RuleBroken,
    check_graph,
)

Shape: TypeAlias = tuple[int | str, ...]

_MAX_FIELDS: Final = 1_000_000  # a model with a thousand nodes has about ten thousand fields
_MAX_RANK: Final = 32
_MAX_METADATA: Final = 2**20  # bytes of one entry; the manifest has about 5000
_FEW_BYTES: Final = 8 * _MAX_RANK
_MAX_NESTING: Final = 2  # branches in branches; a combined file has a choice among three
_FORMATS: Final = {1: "f", 7: "q", 10: "e"}  # of TensorProto.DataType: float32, int64, float16
_DATA_INSIDE: Final = 0  # TensorProto.DataLocation.DEFAULT
_MAX_ELEMENTS_PER_BYTE: Final = 8  # the smallest element types take less than a byte each

_Bytes: TypeAlias = bytes | mmap.mmap
_Span: TypeAlias = tuple[int, int]


@dataclass
class ModelFile:
    """Metadata, inputs, outputs and nodes of a model file.

    Attributes:
        metadata: The metadata entries.
        input_shapes: Shape of each input; dynamic sizes are given by their name.
        output_shapes: Shape of each output, likewise.
        nodes: The nodes of the graph, in the order of execution; those of the branches of an If
            stand before it.
    """

    metadata: dict[str, str] = field(default_factory=dict)
    input_shapes: dict[str, Shape] = field(default_factory=dict)
    output_shapes: dict[str, Shape] = field(default_factory=dict)
    nodes: list[GraphNode] = field(default_factory=list)


class _NotOnnx(Exception):
    """The bytes are not an ONNX model."""


class _Refused(Exception):
    """The file is an ONNX model that must not be opened."""


def read_model_file(path: Path) -> ModelFile:
    """Check a model file and read its metadata, inputs and outputs.

    Raises:
        ModelFileError: The file is missing or unreadable, is not an ONNX model or truncated, refers
            to data in other files, contains less data than it declares, has an input or output of
            more than `MAX_ELEMENTS` elements, or has operators that no export of this project has.
    """
    check_is_file(path)
    try:
        with _errors_naming(path), open_regular(path) as stream:
            if not stream.read(1):
                raise _NotOnnx("it is empty")
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                return _Parser(data).parse_model()
    except OSError as error:
        raise ModelFileError(
            f"model {path} cannot be read ({error.strerror}): expected an .onnx file"
        ) from error


def check_is_file(path: Path) -> None:
    """Check that a model file exists.

    Raises:
        ModelFileError: It does not, or is a folder or another special file.
    """
    if not path.is_file():
        special = "is a pipe, socket or device" if path.exists() else "does not exist"
        problem = "is a folder" if path.is_dir() else special
        raise ModelFileError(f"model {path} {problem}: expected an .onnx file")


def check_content(content: bytes, path: Path) -> ModelFile:
    """Check the content of a model file, as `read_model_file` does.

    Args:
        content: The content.
        path: The file that it is from, for messages.

    Raises:
        ModelFileError: As `read_model_file`.
    """
    with _errors_naming(path):
        if not content:
            raise _NotOnnx("it is empty")
        return _Parser(content).parse_model()


@contextmanager
def _errors_naming(path: Path) -> Iterator[None]:
    try:
        yield
    except _NotOnnx as error:
        if path.suffix == ".safetensors":
            raise ModelFileError(
                f"model {path} is a checkpoint: expected the .onnx file that `edgetree export`"
                " makes of it; `perceptree eval` takes checkpoints"
            ) from error
        raise ModelFileError(
            f"model {path} is not an ONNX model ({error}):"
            " expected a file made by `edgetree export`"
        ) from error
    except (_Refused, RuleBroken) as error:
        raise ModelFileError(f"model {path} {error}") from error


class _Parser:
    """Parses the protobuf messages of one file."""

    def __init__(self, data: _Bytes) -> None:
        self._data = data
        self._fields_left = _MAX_FIELDS
        self._constants: dict[str, Constant] = {}

    def parse_model(self) -> ModelFile:
        """Parse the whole file, a ModelProto, and check all its parts."""
        found = ModelFile()
        graphs: list[_Span] = []
        for number, value in self._fields((0, len(self._data))):
            if number == 7:  # graph
                graphs.append(_span(value))
            elif number == 14:  # metadata_props
                key, text = self._entry(_span(value))
                found.metadata[key] = text
            elif number in (20, 25):  # training_info, functions
                raise _Refused("contains functions or a training graph: expected one plain graph")
        if len(graphs) != 1:
            raise _NotOnnx(f"it has {len(graphs)} graphs")
        self._parse_graph(graphs[0], found)
        check_graph(found.nodes, found.input_shapes, self._constants)
        return found

    def _parse_graph(self, span: _Span, found: ModelFile, nesting: int = 0) -> None:
        """Check all nodes and tensors of the graph, and collect them, inputs and outputs too.

        Of a branch, which has a `nesting` over 0, nodes and constants alone are collected.
        """
        for number, value in self._fields(span):
            if number == 1:  # node
                found.nodes.append(self._node(_span(value), found, nesting))
            elif number == 5:  # initializer
                name, constant = self._tensor(_span(value))
                if name in self._constants:
                    raise _Refused(f"has two constants {name[:100]!r}: expected unique names")
                self._constants[name] = constant
            elif number in (11, 12):  # input, output
                name, shape = self._value_info(_span(value))
                if nesting and number == 11:
                    raise _Refused("has an If whose branch has inputs: expected none")
                if nesting:
                    continue
                (found.input_shapes if number == 11 else found.output_shapes)[name] = shape
            elif number == 15:  # sparse_initializer
                raise _Refused("contains a sparse tensor: expected dense tensors only")

    def _node(self, span: _Span, found: ModelFile, nesting: int) -> GraphNode:
        node = GraphNode()
        branches: list[_Span] = []
        texts = {
            1: node.inputs,
            2: node.outputs,
            3: node.names,
            4: node.operators,
            7: node.domains,
        }
        for number, value in self._fields(span):
            if number in texts:
                texts[number].append(self._text(_span(value)))
            elif number == 5:  # attribute
                self._parse_attribute(_span(value), node, branches)
        if branches and (node.operators != ["If"] or nesting == _MAX_NESTING):
            raise _Refused(
                "contains a graph inside an operator: expected none but the branches of If, not"
                f" deeper than {_MAX_NESTING}"
            )
        for branch in branches:
            self._parse_graph(branch, found, nesting + 1)
        if "EPContext" in node.operators:
            raise _Refused(
                "contains an operator EPContext, compiled for one machine: expected none"
            )
        return node

    def _parse_attribute(self, span: _Span, node: GraphNode, branches: list[_Span]) -> None:
        name, integers = "", []
        for number, value in self._fields(span):
            if number == 1:  # name
                name = self._text(_span(value))
            elif number in (3, 8):  # i, ints
                integers += self._numbers(value)
            elif number in (5, 10):  # t, tensors
                self._tensor(_span(value))
            elif number in (6, 11):  # g, graphs
                branches.append(_span(value))
            elif number in (22, 23):  # sparse_tensor, sparse_tensors
                raise _Refused("contains a sparse tensor: expected dense tensors only")
            if len(integers) > _MAX_RANK:
                raise _Refused(f"has an attribute of more than {_MAX_RANK} numbers: expected fewer")
        node.integers.setdefault(name, []).extend(integers)

    def _tensor(self, span: _Span) -> tuple[str, Constant]:
        """Name and content of a tensor, after a check that all its data are in this file."""
        dims: list[int] = []
        name, kind, raw = "?", 0, (0, 0)
        for number, value in self._fields(span):
            if number == 14 and value != _DATA_INSIDE:  # data_location
                raise _Refused("stores weights in another file: expected a self-contained file")
            if number == 1:  # dims
                dims += self._numbers(value)
            elif number == 2:  # data_type
                kind = _number(value)
            elif number == 8:  # name
                name = self._text(_span(value))
            elif number == 9:  # raw_data
                raw = _span(value)
        size = span[1] - span[0]
        elements = _product(dims)
        if elements > size * _MAX_ELEMENTS_PER_BYTE:
            raise _Refused(
                f"declares its tensor {name[:100]!r} as {'x'.join(map(str, dims))} but contains"
                f" only {size} bytes of it: expected all of its data"
            )
        return name, Constant(elements, self._few_values(kind, elements, raw))

    def _few_values(self, kind: int, elements: int, raw: _Span) -> tuple[float, ...] | None:
        """The values of a small tensor of numbers; None for other tensors."""
        data = self._data[slice(*raw)] if raw[1] - raw[0] <= _FEW_BYTES else b""
        layout = f"<{elements}{_FORMATS.get(kind, 'q')}" if elements <= _MAX_RANK else ""
        if kind not in _FORMATS or not layout or struct.calcsize(layout) != len(data):
            return None
        return struct.unpack(layout, data)

    def _value_info(self, span: _Span) -> tuple[str, Shape]:
        """Name and shape of an input or output; the shape is () if it is not a tensor."""
        name = "".join(map(self._text, self._children(span, 1)))
        sizes = [
            self._size(dim)
            for kind in self._children(span, 2)
            for tensor in self._children(kind, 1)
            for shape in self._children(tensor, 2)
            for dim in self._children(shape, 1)
        ]
        known = [size for size in sizes if isinstance(size, int)]
        if min(known, default=1) < 1 or _product(known) > MAX_ELEMENTS:
            text = "x".join(str(size)[:100] for size in sizes)
            raise _Refused(
                f"declares {name[:100]!r} as {text}: expected sizes of at least 1"
                f" and at most {MAX_ELEMENTS} elements"
            )
        return name, tuple(sizes)

    def _size(self, span: _Span) -> int | str:
        for number, value in self._fields(span):
            if number == 1:
                return _number(value)
            if number == 2:
                return self._text(_span(value))
        return "?"

    def _entry(self, span: _Span) -> tuple[str, str]:
        if span[1] - span[0] > _MAX_METADATA:
            raise _Refused(f"has more than {_MAX_METADATA} bytes of metadata: expected fewer")
        texts = {number: self._text(_span(value)) for number, value in self._fields(span)}
        return texts.get(1, ""), texts.get(2, "")

    def _text(self, span: _Span) -> str:
        try:
            return self._data[slice(*span)].decode("utf-8")
        except UnicodeDecodeError as error:
            raise _NotOnnx("a name or text in it is not UTF-8") from error

    def _numbers(self, value: int | _Span) -> list[int]:
        """One integer, or a packed list of integers."""
        if isinstance(value, int):
            return [value]
        position, end = value
        found: list[int] = []
        while position < end and len(found) <= _MAX_RANK:
            number, position = self._varint(position, end)
            found.append(number)
        return found

    def _children(self, span: _Span, number: int) -> list[_Span]:
        """Byte ranges of all sub-messages with field number `number`."""
        return [_span(value) for index, value in self._fields(span) if index == number]

    def _fields(self, span: _Span) -> Iterator[tuple[int, int | _Span]]:
        """Yield (number, value) of each field; values other than varints as their byte range."""
        data = self._data
        position, end = span
        while position < end:
            self._fields_left -= 1
            if self._fields_left < 0:
                raise _Refused(f"has more than {_MAX_FIELDS} fields: expected fewer")
            key = data[position]
            if key < 0x80:  # nearly all keys and lengths are one byte
                position += 1
            else:
                key, position = self._varint(position, end)
            number, kind = (key & 0xFFFF_FFFF) >> 3, key & 7  # some parsers use only 32 bits
            if kind == 2:
                length = data[position] if position < end else 0x80
                if length < 0x80:
                    position += 1
                else:
                    length, position = self._varint(position, end)
            elif kind == 0:
                value, position = self._varint(position, end)
                yield number, value
                continue
            elif kind in (1, 5):
                length = 8 if kind == 1 else 4
            else:
                raise _NotOnnx(f"no valid field at byte {position}")
            field_end = position + length
            if field_end > end:
                raise _NotOnnx("it is truncated or damaged: a field reaches past its end")
            yield number, (position, field_end)
            position = field_end

    def _varint(self, position: int, end: int) -> tuple[int, int]:
        """Decode a varint: up to ten bytes of seven bits each, least significant first.

        Negative numbers are returned as unsigned 64-bit numbers, which later size checks reject.

        Returns:
            The number and the position behind it.
        """
        number = 0
        for shift in range(0, 70, 7):
            if position >= end:
                raise _NotOnnx("it is truncated or damaged: a number reaches past its end")
            byte = self._data[position]
            position += 1
            number |= (byte & 0x7F) << shift
            if byte < 0x80:
                return number & 0xFFFF_FFFF_FFFF_FFFF, position
        raise _NotOnnx(f"the number that ends at byte {position} is longer than ten bytes")


def _product(sizes: list[int]) -> int:
    if len(sizes) > _MAX_RANK:
        raise _Refused(f"declares a tensor of {len(sizes)} axes: expected at most {_MAX_RANK}")
    return math.prod(sizes)


def _span(value: int | _Span) -> _Span:
    if isinstance(value, int):
        raise _NotOnnx("a number where a message or text was expected")
    return value


def _number(value: int | _Span) -> int:
    if not isinstance(value, int):
        raise _NotOnnx("a message or text where a number was expected")
    return value
