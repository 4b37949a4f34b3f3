"""Point clouds in PCD files: text, binary, and binary compressed with LZF.

Format: The PCD (Point Cloud Data) file format, documentation of the Point Cloud Library.
"""

from __future__ import annotations

import struct
from typing import Any, Final

import numpy as np

from basetree.arrays import Float
from calib.clouds.cloud import check_count, xyz_of_records
from calib.clouds.lzf import decompress
from calib.clouds.ply import read_rows
from calib.errors import CloudError

STARTS: Final = (b"# .PCD", b"VERSION", b"FIELDS")
_KINDS: Final = {
    ("F", 4): "f4",
    ("F", 8): "f8",
    ("I", 1): "i1",
    ("I", 2): "i2",
    ("I", 4): "i4",
    ("I", 8): "i8",
    ("U", 1): "u1",
    ("U", 2): "u2",
    ("U", 4): "u4",
    ("U", 8): "u8",
}
_MOST_HEADER_BYTES: Final = 2**16
_MOST_REPEATS: Final = 10_000  # of a field's numbers in a point
_LARGEST_EXPANSION: Final = 100  # of LZF, whose 3 bytes hold at most 264


def read_pcd(data: bytes) -> Float:
    """The points of a PCD file as (N, 3) coordinates, in the frame in which they are stored.

    Raises:
        CloudError: If the file is damaged.
    """
    header, content = _header(data)
    record = _record(header)
    count = _count(header)
    check_count(count)
    kind = " ".join(header.get("DATA", [])).lower()
    if kind == "ascii":
        flat = np.dtype([(name, "f8") for name in _flat_names(record)])
        return xyz_of_records(read_rows(content, count, flat))
    if kind == "binary":
        there = len(content) // record.itemsize
        if there < count:
            raise CloudError(f"it ends after {there} of {count} points: expected all")
        return xyz_of_records(np.frombuffer(content, record, count))
    if kind == "binary_compressed":
        return xyz_of_records(_compressed(content, record, count))
    raise CloudError(f"its DATA is {kind!r}: expected ascii, binary or binary_compressed")


def _header(data: bytes) -> tuple[dict[str, list[str]], bytes]:
    """The words of each line of the header, by the first one, and what follows it."""
    found: dict[str, list[str]] = {}
    at = 0
    while at < min(len(data), _MOST_HEADER_BYTES):
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        words = data[at:end].decode("latin-1").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            found[words[0].upper()] = words[1:]
            if words[0].upper() == "DATA":
                return found, data[at:]
    raise CloudError("its PCD header has no line DATA: expected one")


def _record(header: dict[str, list[str]]) -> np.dtype[Any]:
    names = header.get("FIELDS", [])
    repeats = header.get("COUNT", ["1"] * len(names))
    columns = (names, header.get("SIZE", []), header.get("TYPE", []), repeats)
    if not names or len({len(column) for column in columns}) != 1:
        raise CloudError("FIELDS, SIZE, TYPE and COUNT of its PCD header differ in length")
    fields = []
    for index, (name, size, kind, repeat) in enumerate(zip(*columns, strict=True)):
        found = _KINDS.get((kind.upper(), int(size) if size.isdecimal() else 0))
        number = int(repeat) if repeat.isascii() and repeat.isdigit() and len(repeat) < 6 else 0
        if found is None or not 1 <= number <= _MOST_REPEATS:
            raise CloudError(
                f"the PCD field {name} has size {size}, type {kind} and count {repeat}: expected"
                " sizes 1, 2, 4 or 8, types F, I or U"
            )
        unique = name if names.count(name) == 1 else f"{name} {index}"  # such as padding, _
        fields.append((unique, "<" + found) if number == 1 else (unique, "<" + found, (number,)))
    return np.dtype(fields)


def _flat_names(record: np.dtype[Any]) -> list[str]:
    """One name for each number of a row of text."""
    names = []
    for name in record.names or ():
        shape = record[name].shape
        names += [name] if not shape else [f"{name} {index}" for index in range(shape[0])]
    return names


def _count(header: dict[str, list[str]]) -> int:
    words = header.get("POINTS") or [*header.get("WIDTH", []), *header.get("HEIGHT", ["1"])]
    if not words or not all(word.isascii() and word.isdigit() for word in words):
        raise CloudError(f"its PCD header states {words} points: expected a number")
    count = 1
    for word in words[:2]:
        count *= int(word[:20])
    return count


def _compressed(content: bytes, record: np.dtype[Any], count: int) -> np.ndarray[Any, Any]:
    """The records of compressed points, which are stored field by field."""
    if len(content) < 8:
        raise CloudError("it ends before its compressed points: expected them")
    packed, size = struct.unpack_from("<II", content)
    if packed > len(content) - 8 or size != count * record.itemsize:
        raise CloudError(
            f"it states {packed} bytes that hold {size}, and has {len(content) - 8} for {count}"
            f" points of {record.itemsize} bytes: the file is damaged or not complete"
        )
    if size > _LARGEST_EXPANSION * packed:
        raise CloudError(f"{packed} bytes cannot hold the stated {size}: the file is damaged")
    try:
        data = decompress(content[8 : 8 + packed], size)
    except ValueError as error:
        raise CloudError(f"its points cannot be unpacked: {error}") from error
    points = np.zeros(
        count, [(name, "<f8") for name in ("x", "y", "z") if name in (record.names or ())]
    )
    at = 0
    for name in record.names or ():
        kind = record[name]
        if name in (points.dtype.names or ()) and not kind.shape:
            points[name] = np.frombuffer(data, kind, count, at)
        at += kind.itemsize * count
    return points
