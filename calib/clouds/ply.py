"""Point clouds in PLY files: text, and binary of both byte orders.

Format: G. Turk, The PLY Polygon File Format (1994).
"""

from __future__ import annotations

import io
import warnings
from typing import Any, Final, NamedTuple

import numpy as np

from basetree.arrays import Float
from calib.clouds.cloud import check_count, xyz_of_records
from calib.errors import CloudError

MAGIC: Final = b"ply"
_TYPES: Final = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_ORDERS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_MOST_HEADER_BYTES: Final = 2**16
_END: Final = b"end_header"


class _Element(NamedTuple):
    """An element of a header: its name, number, and properties as (name, type of numpy)."""

    name: str
    number: int
    properties: list[tuple[str, str]]


def read_ply(data: bytes) -> Float:
    """The vertices of a PLY file as (N, 3) coordinates.

    Raises:
        CloudError: If the file is damaged, or holds something else.
    """
    end = data.find(_END, 0, _MOST_HEADER_BYTES)
    start = data.find(b"\n", end) + 1
    if end < 0 or not start:
        raise CloudError("its PLY header has no end: expected end_header")
    lines = [line.split() for line in data[:end].decode("latin-1").splitlines()]
    format_name, elements = _parse(lines)
    content = memoryview(data)[start:]
    for element in elements:
        if element.name == "vertex":
            return _vertices(content, format_name, element)
        content = content[_size_of(content, format_name, element) :]
    raise CloudError("its PLY header names no element vertex: expected one")


def _parse(lines: list[list[str]]) -> tuple[str, list[_Element]]:
    format_name, elements = "", list[_Element]()
    for words in lines:
        match words:
            case ["format", name, *_]:
                format_name = name
            case ["element", name, count]:
                number = int(count) if count.isascii() and count.isdigit() else -1
                elements.append(_Element(name, number, []))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind]))
            case ["property", *rest] if elements:
                elements[-1].properties.append((" ".join(rest), ""))  # a list, or unknown
    if format_name not in _ORDERS:
        raise CloudError(f"its PLY format is {format_name!r}: expected {', '.join(_ORDERS)}")
    return format_name, elements


def _record(element: _Element, format_name: str) -> np.dtype[Any]:
    for name, kind in element.properties:
        if not kind:
            raise CloudError(
                f"the PLY element {element.name} has the property {name!r}: expected numbers alone,"
                " and the vertices first"
            )
    names = [name for name, _ in element.properties]
    if len(set(names)) < len(names) or not names:
        raise CloudError(f"the PLY element {element.name} has the properties {names}")
    order = _ORDERS[format_name]
    return np.dtype([(name, order + kind) for name, kind in element.properties])


def _size_of(content: memoryview, format_name: str, element: _Element) -> int:
    """Bytes of an element before the vertices."""
    check_count(element.number)
    if format_name != "ascii":
        return element.number * _record(element, format_name).itemsize
    at = 0
    data = bytes(content)
    for _ in range(element.number):
        at = data.find(b"\n", at) + 1
        if not at:
            return len(data)
    return at


def _vertices(content: memoryview, format_name: str, element: _Element) -> Float:
    record = _record(element, format_name)
    check_count(element.number)
    if format_name == "ascii":
        return xyz_of_records(read_rows(bytes(content), element.number, record))
    there = len(content) // record.itemsize
    if there < element.number:
        raise CloudError(f"it ends after {there} of {element.number} points: expected all")
    return xyz_of_records(np.frombuffer(content, record, element.number))


def read_rows(text: bytes, count: int, record: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """Records of `count` rows of numbers in a text, as PLY and PCD have them.

    Raises:
        CloudError: If a row is damaged or missing.
    """
    names = record.names or ()
    columns = [names.index(name) for name in names if name.lower() in ("x", "y", "z")]
    if len(columns) != 3 or not count:
        return np.zeros(0, record)
    options: dict[str, Any] = {"comments": None, "usecols": columns, "max_rows": count, "ndmin": 2}
    try:
        with warnings.catch_warnings():  # of too few rows, which are told below
            warnings.simplefilter("ignore")
            found = np.loadtxt(io.BytesIO(text), np.float64, **options)
    except (ValueError, IndexError, OverflowError, UnicodeError) as error:
        raise CloudError(f"a row of its points cannot be read ({error})") from error
    if len(found) < count:
        raise CloudError(f"it ends after {len(found)} of {count} points: expected all")
    rows = np.zeros(count, [(names[column], "f8") for column in columns])
    for column, values in zip(columns, found.T, strict=True):
        rows[names[column]] = values
    return rows
