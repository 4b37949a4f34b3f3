"""Arrays out of a plain pickle, of which nothing is executed.

A pickle is a program that names the functions it calls. Here every name that it may use stands
for an inert record of what was said, so that a hostile file can neither run nor import anything,
and a claimed shape allocates nothing; arrays are made of the bytes afterwards.
"""

from __future__ import annotations

import math
import mmap
import pickle
import pickletools
from collections.abc import Mapping
from typing import IO, Any, BinaryIO, cast

import numpy as np

_NUMBERS = {f"{kind}{size}" for kind in "fiu" for size in (1, 2, 4, 8)} - {"f1"} | {"b1"}
_ORDERS = ("<", ">", "=", "|")
_LATIN_1 = ("latin1", "latin-1")
_MOST_AXES = 8
_INDEXED = ("PUT", "BINPUT", "LONG_BINPUT")


class _Inert:
    """Something that is of no use here, such as a numpy number of a training's bookkeeping."""

    def __init__(self, *_: object) -> None:
        pass

    def __setstate__(self, _: object) -> None:
        pass


class _Bytes(bytes):
    """Bytes that an old protocol spells as latin-1 text."""

    def __new__(cls, text: object, encoding: object) -> _Bytes:
        if not isinstance(text, str) or encoding not in _LATIN_1:
            raise ValueError("text that does not stand for bytes")
        return super().__new__(cls, text.encode("latin-1"))

    def __setstate__(self, _: object) -> None:
        raise ValueError("bytes with a state")


class _Mapping(dict[Any, Any]):
    """An ordered dictionary, without the attributes that a network's state carries."""

    def __setstate__(self, _: object) -> None:
        pass


class _Dtype:
    """The type of an array's numbers, such as ``f4``."""

    def __init__(self, code: object, *_: object) -> None:
        self.code, self.order = code, "|"

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.order = state[1]

    def build(self) -> np.dtype[Any]:
        """The dtype itself; raises ValueError for anything but plain numbers."""
        if self.code not in _NUMBERS or self.order not in _ORDERS:
            raise ValueError("numbers that are no plain floats or integers")
        return np.dtype(f"{self.order}{self.code}")


class ArrayRecord:
    """What a pickle says of one array, not yet believed."""

    def __init__(self, *_: object) -> None:
        self._parts: tuple[Any, ...] = ()

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        shape, dtype, by_columns, raw = state[-4:]
        self._parts = (raw, dtype, shape, "F" if by_columns else "C", None)

    def build(self) -> np.ndarray[Any, Any]:
        """The array; raises ValueError where bytes, type and shape contradict each other."""
        raw, dtype, shape, order, axes = self._parts or (None,) * 5
        if isinstance(raw, str):  # as written by Python 2
            raw = raw.encode("latin-1")
        if not isinstance(dtype, _Dtype) or not isinstance(raw, bytes | bytearray):
            raise ValueError("an array without a type or without bytes")
        if not _is_shape(shape):
            raise ValueError("an array with a shape that is none")
        numbers = dtype.build()
        expected = math.prod(shape) * numbers.itemsize
        if len(raw) != expected:
            raise ValueError(f"{len(raw)} bytes for the shape {shape}, expected {expected}")
        flat = np.frombuffer(raw, numbers).astype(numbers.newbyteorder("="))
        if order == "K" and axes is not None:
            return flat.reshape(shape).transpose(axes)
        return flat.reshape(shape, order="F" if order == "F" else "C")


class _BufferRecord(ArrayRecord):
    """The same as protocol 5 says it."""

    def __init__(
        self, raw: object, dtype: object, shape: object, order: object, axes: object = None
    ) -> None:
        super().__init__()
        self._parts = (raw, dtype, shape, order, axes)


def _is_shape(shape: object) -> bool:
    return (
        isinstance(shape, tuple)
        and len(shape) <= _MOST_AXES
        and all(type(side) is int and side >= 0 for side in shape)
    )


_STAND_INS: Mapping[tuple[str, str], type] = {
    ("_codecs", "encode"): _Bytes,
    ("collections", "OrderedDict"): _Mapping,
    ("numpy", "dtype"): _Dtype,
    ("numpy", "ndarray"): _Inert,
    ("numpy.core.multiarray", "_reconstruct"): ArrayRecord,
    ("numpy._core.multiarray", "_reconstruct"): ArrayRecord,
    ("numpy.core.multiarray", "scalar"): _Inert,
    ("numpy._core.multiarray", "scalar"): _Inert,
    ("numpy.core.numeric", "_frombuffer"): _BufferRecord,
    ("numpy._core.numeric", "_frombuffer"): _BufferRecord,
}

BOOKKEEPING: tuple[tuple[type, str], ...] = tuple(
    (stand_in, ".".join(name))
    for name, stand_in in _STAND_INS.items()
    if name[0].startswith("numpy")
)
"""The stand-ins as ``torch.serialization.safe_globals`` takes them."""


class _Unpickler(pickle.Unpickler):
    """Reads a pickle with the stand-ins alone."""

    def find_class(self, module: str, name: str) -> type:
        """The stand-in for a name; raises UnpicklingError for one that weights do not need."""
        stand_in = _STAND_INS.get((module, name))
        if stand_in is None:
            raise pickle.UnpicklingError(f"unsupported GLOBAL {module}.{name}")
        return stand_in


def read_pickle(file: BinaryIO) -> Any:
    """A pickle's content, with an :class:`ArrayRecord` in place of each array.

    What is broken raises whatever Python's reader raises there, any subclass of Exception.
    """
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        _check_claims(content)
        content.seek(0)
        return _Unpickler(content, encoding="latin1").load()


def _check_claims(content: mmap.mmap) -> None:
    """Raise ValueError for lengths and indices over what the file has.

    Python's reader sets memory aside for whatever is claimed; this walk raises for lengths of
    its own accord.
    """
    for number, (code, argument, _) in enumerate(pickletools.genops(cast("IO[bytes]", content))):
        if code.name in _INDEXED and int(argument or 0) > number:
            raise ValueError(f"index {argument} after {number} steps")
