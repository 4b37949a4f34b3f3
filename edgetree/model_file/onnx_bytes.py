"""Write small ONNX models without the `onnx` package, which the base install does not have.

Supports operators without attributes, constants and metadata. The numbers are field numbers in
onnx.proto; see https://protobuf.dev/programming-guides/encoding for the encoding.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

_IR_VERSION: Final = 8
_OPSET: Final = 17
_TYPES: Final = {"float32": 1, "uint8": 2, "int8": 3, "int32": 6, "int64": 7}


class Node(NamedTuple):
    """An operator with default attributes."""

    operator: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


class TensorType(NamedTuple):
    """Dtype and shape of an input or output; a text in the shape names a dynamic size."""

    dtype: str
    shape: tuple[int | str, ...]


def onnx_bytes(
    nodes: Iterable[Node],
    *,
    inputs: Mapping[str, TensorType],
    outputs: Mapping[str, TensorType],
    constants: Mapping[str, NDArray[Any]],
    metadata: Mapping[str, str] | None = None,
) -> bytes:
    """Encode an ONNX model.

    Args:
        nodes: The operators, in execution order.
        inputs: The graph's inputs by name.
        outputs: The graph's outputs by name.
        constants: Arrays of the types above, which operators use as inputs.
        metadata: Custom metadata of the model.

    Returns:
        The content of the .onnx file.
    """
    graph = [
        *(_message(1, *_node(node)) for node in nodes),
        _bytes(2, "graph"),
        *(_message(5, *_tensor(name, value)) for name, value in constants.items()),
        *(_message(11, *_value(name, kind)) for name, kind in inputs.items()),
        *(_message(12, *_value(name, kind)) for name, kind in outputs.items()),
    ]
    entries = (metadata or {}).items()
    return b"".join(
        [
            _number(1, _IR_VERSION),
            _message(7, *graph),
            _message(8, _bytes(1, ""), _number(2, _OPSET)),
            *(_message(14, _bytes(1, key), _bytes(2, value)) for key, value in entries),
        ]
    )


def _node(node: Node) -> list[bytes]:
    inputs = [_bytes(1, name) for name in node.inputs]
    return [*inputs, *(_bytes(2, name) for name in node.outputs), _bytes(4, node.operator)]


def _tensor(name: str, value: NDArray[Any]) -> list[bytes]:
    sizes = [_number(1, size) for size in value.shape]
    little_endian = np.ascontiguousarray(value, value.dtype.newbyteorder("<")).tobytes()
    kind = _number(2, _TYPES[value.dtype.name])
    return [*sizes, kind, _bytes(8, name), _bytes(9, little_endian)]


def _value(name: str, kind: TensorType) -> list[bytes]:
    sizes = [
        _message(1, _bytes(2, size) if isinstance(size, str) else _number(1, size))
        for size in kind.shape
    ]
    tensor = _message(1, _number(1, _TYPES[kind.dtype]), _message(2, *sizes))
    return [_bytes(1, name), _message(2, tensor)]


def _message(field: int, *parts: bytes) -> bytes:
    return _bytes(field, b"".join(parts))


def _bytes(field: int, value: bytes | str) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _varint(value: int) -> bytes:
    """Seven bits per byte, least significant first; the eighth bit marks that more follow."""
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + _varint(rest) if rest else bytes([low])
