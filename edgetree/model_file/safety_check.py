"""A first look at a model file, before onnxruntime opens it, with nothing but its bytes.

Our files are whole: one ONNX file, nothing beside it. An ONNX model may also point to other
files, declare tensors that it does not hold, or be cut short, and what opens it would read those
files or ask for that memory. So the file's structure is walked once; the weights are passed over.

ONNX is protobuf: a message is a row of fields, each a number, a kind and a value; the names of
the fields below are those of onnx.proto.
"""

from __future__ import annotations

import math
import mmap
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeAlias

from edgetree.errors import ModelFileError

__all__ = ["MAX_ELEMENTS", "ModelFile", "Shape", "read_model_file"]

Shape: TypeAlias = tuple[int | str, ...]

MAX_ELEMENTS: Final = 2**28  # of one input or output
_MAX_FIELDS: Final = 1_000_000  # a model of a thousand nodes has some ten thousand
_MAX_RANK: Final = 32
_HERE: Final = 0  # TensorProto.DataLocation.DEFAULT
_MOST_PER_BYTE: Final = 8  # elements; the narrowest types take less than a byte each

_Bytes: TypeAlias = bytes | mmap.mmap
_Span: TypeAlias = tuple[int, int]


@dataclass
class ModelFile:
    """What a model file says of itself.

    Attributes:
        metadata: its metadata.
        input_shapes: shape of each input; a text stands for a size that is free.
        output_shapes: likewise of each output.
    """

    metadata: dict[str, str] = field(default_factory=dict)
    input_shapes: dict[str, Shape] = field(default_factory=dict)
    output_shapes: dict[str, Shape] = field(default_factory=dict)


class _NotOnnx(Exception):
    """The bytes are no ONNX model."""


class _Refused(Exception):
    """An ONNX model, but not one that may be opened."""


def read_model_file(path: Path) -> ModelFile:
    """Look a model file through.

    Raises:
        ModelFileError: the file is missing or cannot be read, is no ONNX model or cut short, keeps
            data outside itself, holds less data than it declares, or declares an input or output
            of more than `MAX_ELEMENTS`.
    """
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "not there"
        raise ModelFileError(f"model {path} is {kind}: expected an .onnx file")
    try:
        with path.open("rb") as stream:
            if not stream.read(1):
                raise _NotOnnx("it is empty")
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                return _Walk(data).model()
    except OSError as error:
        raise ModelFileError(
            f"model {path} cannot be read ({error.strerror}): expected an .onnx file"
        ) from error
    except _NotOnnx as error:
        raise ModelFileError(
            f"model {path} is not an ONNX model ({error}):"
            " expected a file made by `edgetree export`"
        ) from error
    except _Refused as error:
        raise ModelFileError(f"model {path} {error}") from error


class _Walk:
    """Goes through one file's messages."""

    def __init__(self, data: _Bytes) -> None:
        self._data = data
        self._fields_left = _MAX_FIELDS

    def model(self) -> ModelFile:
        """All of the file, a ModelProto."""
        found = ModelFile()
        graphs: list[_Span] = []
        parts: list[tuple[str, _Span]] = []
        for number, value in self._fields((0, len(self._data))):
            if number == 7:  # graph
                graphs.append(_span(value))
            elif number == 14:  # metadata_props
                key, text = self._entry(_span(value))
                found.metadata[key] = text
            elif number == 20:  # training_info: initialization, algorithm
                for inner in (1, 2):
                    parts += [("graph", part) for part in self._children(_span(value), inner)]
            elif number == 25:  # functions: node, attribute_proto
                for inner, kind in ((7, "node"), (11, "attribute")):
                    parts += [(kind, part) for part in self._children(_span(value), inner)]
        if len(graphs) != 1:
            raise _NotOnnx(f"it has {len(graphs)} graphs")
        for number, value in self._fields(graphs[0]):
            if number in (11, 12):  # input, output
                name, shape = self._value_info(_span(value))
                (found.input_shapes if number == 11 else found.output_shapes)[name] = shape
        self._check_parts([*parts, ("graph", graphs[0])])
        return found

    def _check_parts(self, waiting: list[tuple[str, _Span]]) -> None:
        """Every graph and node, those inside others included, and every tensor."""
        while waiting:
            kind, span = waiting.pop()
            for number, value in self._fields(span):
                what = _HOLDS[kind].get(number)
                if what == "tensor":
                    self._check_tensor(_span(value))
                elif what == "sparse tensor":
                    raise _Refused("holds a sparse tensor: expected none, as in all our files")
                elif what == "operator":
                    self._check_operator(_span(value))
                elif what is not None:
                    waiting.append((what, _span(value)))

    def _check_operator(self, span: _Span) -> None:
        if self._data[slice(*span)] == b"EPContext":
            raise _Refused("holds a part compiled for one machine: expected operators alone")

    def _check_tensor(self, span: _Span) -> None:
        """It lies in this file, all of it."""
        dims: list[int] = []
        name = "?"
        for number, value in self._fields(span):
            if number == 14 and value != _HERE:  # data_location
                raise _Refused(
                    "keeps weights in another file: expected one file with everything in it"
                )
            if number == 1:  # dims
                dims += self._numbers(value)
            elif number == 8:
                name = self._text(_span(value))
        size = span[1] - span[0]
        if _product(dims) > size * _MOST_PER_BYTE:
            raise _Refused(
                f"declares its tensor {name!r} as {'x'.join(map(str, dims))} and holds"
                f" {size} bytes of it: expected all of them"
            )

    def _value_info(self, span: _Span) -> tuple[str, Shape]:
        """Name and shape of an input or output; () where it is no tensor."""
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
            text = "x".join(map(str, sizes))
            raise _Refused(
                f"declares {name!r} of {text}: expected sizes from 1 on,"
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
        texts = {number: self._text(_span(value)) for number, value in self._fields(span)}
        return texts.get(1, ""), texts.get(2, "")

    def _text(self, span: _Span) -> str:
        try:
            return self._data[slice(*span)].decode("utf-8")
        except UnicodeDecodeError as error:
            raise _NotOnnx("a name or text in it is not UTF-8") from error

    def _numbers(self, value: int | _Span) -> list[int]:
        """One whole number, or a packed row of them."""
        if isinstance(value, int):
            return [value]
        position, end = value
        found: list[int] = []
        while position < end and len(found) <= _MAX_RANK:
            number, position = self._varint(position, end)
            found.append(number)
        return found

    def _children(self, span: _Span, number: int) -> list[_Span]:
        """Places of the parts that a message holds under one number."""
        return [_span(value) for index, value in self._fields(span) if index == number]

    def _fields(self, span: _Span) -> Iterator[tuple[int, int | _Span]]:
        """(number, value) of each field: whole numbers as they are, the others as their place."""
        position, end = span
        while position < end:
            self._fields_left -= 1
            if self._fields_left < 0:
                raise _Refused(f"has more than {_MAX_FIELDS} parts: expected fewer")
            key, position = self._varint(position, end)
            number, kind = (key & 0xFFFF_FFFF) >> 3, key & 7  # as some readers cut it
            if kind == 0:
                value, position = self._varint(position, end)
                yield number, value
                continue
            if kind == 2:
                length, position = self._varint(position, end)
            elif kind in (1, 5):
                length = 8 if kind == 1 else 4
            else:
                raise _NotOnnx(f"byte {position} begins no field")
            if length > end - position:
                raise _NotOnnx("it is cut short or damaged: a field reaches past its end")
            yield number, (position, position + length)
            position += length

    def _varint(self, position: int, end: int) -> tuple[int, int]:
        """A whole number of up to ten bytes of seven bits, least first; and where it ends.

        A negative one comes out as a huge one, which no size is.
        """
        number = 0
        for shift in range(0, 70, 7):
            if position >= end:
                raise _NotOnnx("it is cut short or damaged: a number reaches past its end")
            byte = self._data[position]
            position += 1
            number |= (byte & 0x7F) << shift
            if byte < 0x80:
                return number & 0xFFFF_FFFF_FFFF_FFFF, position
        raise _NotOnnx(f"byte {position} belongs to a number that does not end")


# What to look into: by message, the numbers of its fields.
_HOLDS: Final[dict[str, dict[int, str]]] = {
    "graph": {1: "node", 5: "tensor", 15: "sparse tensor"},
    "node": {4: "operator", 5: "attribute"},
    "attribute": {
        5: "tensor",
        6: "graph",
        10: "tensor",
        11: "graph",
        22: "sparse tensor",
        23: "sparse tensor",
    },
}


def _product(sizes: list[int]) -> int:
    if len(sizes) > _MAX_RANK:
        raise _Refused(f"declares a tensor of {len(sizes)} axes: expected at most {_MAX_RANK}")
    return math.prod(sizes)


def _span(value: int | _Span) -> _Span:
    if isinstance(value, int):
        raise _NotOnnx("a part of it is a number")
    return value


def _number(value: int | _Span) -> int:
    if not isinstance(value, int):
        raise _NotOnnx("a number in it is none")
    return value
