"""Read arrays from a pickle without executing anything from it.

A pickle is a program that names the functions it calls. This reader replaces each allowed name by
a class that only records its arguments, and refuses all other names. A malicious file can
therefore neither import nor run code, and a stated shape allocates no memory. The arrays are built
from the recorded bytes afterwards.
"""

from __future__ import annotations

import math
import mmap
import pickle
import pickletools
from collections.abc import Callable, Mapping
from typing import IO, Any, BinaryIO, cast

import numpy as np

_NUMBERS = {f"{kind}{size}" for kind in "fiu" for size in (1, 2, 4, 8)} - {"f1"} | {"b1"}
_ORDERS = ("<", ">", "=", "|")
_LATIN_1 = ("latin1", "latin-1")
_MOST_AXES = 8
_INDEXED = ("PUT", "BINPUT", "LONG_BINPUT")


class _Ignored:
    """An object that is not needed, such as a numpy scalar with a training's progress."""

    def __init__(self, *_: object) -> None:
        pass

    def __setstate__(self, _: object) -> None:
        pass


class _Bytes(bytes):
    """Bytes that old pickle protocols store as latin-1 text."""

    def __new__(cls, text: object, encoding: object) -> _Bytes:
        if not isinstance(text, str) or encoding not in _LATIN_1:
            raise ValueError("encoded text that is not latin-1 bytes")
        return super().__new__(cls, text.encode("latin-1"))

    def __setstate__(self, _: object) -> None:
        raise ValueError("bytes with a state")


class _Mapping(dict[Any, Any]):
    """An ordered dictionary; its attributes, such as a state dict's metadata, are ignored."""

    def __setstate__(self, _: object) -> None:
        pass


class _Dtype:
    """A recorded numpy dtype, such as `f4`."""

    def __init__(self, code: object, *_: object) -> None:
        self.code, self.order = code, "|"

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.order = state[1]

    def build(self) -> np.dtype[Any]:
        """Make the dtype.

        Raises:
            ValueError: If it is neither a float nor an integer nor bool.
        """
        if self.code not in _NUMBERS or self.order not in _ORDERS:
            raise ValueError("a dtype that is neither a float nor an integer")
        return np.dtype(f"{self.order}{self.code}")


class ArrayRecord:
    """The recorded description of one array, not yet validated."""

    def __init__(self, *_: object) -> None:
        self._parts: tuple[Any, ...] = ()

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        shape, dtype, by_columns, raw = state[-4:]
        self._parts = (raw, dtype, shape, "F" if by_columns else "C", None)

    @property
    def stored_bytes(self) -> int:
        """Size of the recorded bytes; 0 if there are none."""
        raw = self._parts[0] if self._parts else b""
        return len(raw) if isinstance(raw, str | bytes | bytearray) else 0

    def build(self) -> np.ndarray[Any, Any]:
        """Make the array.

        Raises:
            ValueError: If bytes, dtype and shape do not fit each other.
        """
        raw, dtype, shape, order, axes = self._parts or (None,) * 5
        if isinstance(raw, str):  # as written by Python 2
            raw = raw.encode("latin-1")
        if not isinstance(dtype, _Dtype) or not isinstance(raw, bytes | bytearray):
            raise ValueError("an array without a dtype or without bytes")
        if not _is_shape(shape):
            raise ValueError("an array with an invalid shape")
        numbers = dtype.build()
        expected = math.prod(shape) * numbers.itemsize
        if len(raw) != expected:
            raise ValueError(f"{len(raw)} bytes for the shape {shape}, expected {expected}")
        flat = np.frombuffer(raw, numbers).astype(numbers.newbyteorder("="))
        if order == "K" and axes is not None:
            return flat.reshape(shape).transpose(axes)
        return flat.reshape(shape, order="F" if order == "F" else "C")


class _BufferRecord(ArrayRecord):
    """An array as pickle protocol 5 stores it."""

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
    ("collections", "OrderedDict"): _Mapping,
    ("numpy", "dtype"): _Dtype,
    ("numpy", "ndarray"): _Ignored,
    ("numpy.core.multiarray", "_reconstruct"): ArrayRecord,
    ("numpy._core.multiarray", "_reconstruct"): ArrayRecord,
    ("numpy.core.multiarray", "scalar"): _Ignored,
    ("numpy._core.multiarray", "scalar"): _Ignored,
    ("numpy.core.numeric", "_frombuffer"): _BufferRecord,
    ("numpy._core.numeric", "_frombuffer"): _BufferRecord,
}

SAFE_GLOBALS: tuple[tuple[type, str], ...] = tuple(
    (stand_in, ".".join(name))
    for name, stand_in in _STAND_INS.items()
    if name[0].startswith("numpy")
)
"""The numpy stand-ins in the form that `torch.serialization.safe_globals` takes."""


class _Unpickler(pickle.Unpickler):
    """An unpickler that knows only the stand-ins, and encodes no more text than the file holds."""

    def __init__(self, content: mmap.mmap) -> None:
        super().__init__(cast("BinaryIO", content), encoding="latin1")
        self._left = len(content)

    def _encode(self, text: object, encoding: object = None) -> _Bytes:
        """Encode a text; a pickle can name one long text any number of times."""
        self._left -= len(text) if isinstance(text, str) else 0
        if self._left < 0:
            raise ValueError("more encoded text than the file holds")
        return _Bytes(text, encoding)

    def find_class(self, module: str, name: str) -> Callable[..., Any]:
        """Return the stand-in for a name.

        Raises:
            UnpicklingError: If there is none.
        """
        if (module, name) == ("_codecs", "encode"):
            return self._encode
        stand_in = _STAND_INS.get((module, name))
        if stand_in is None:
            raise pickle.UnpicklingError(f"unsupported GLOBAL {module}.{name}")
        return stand_in


def read_pickle(file: BinaryIO) -> Any:
    """Read a pickle's content, with an `ArrayRecord` in place of each array.

    Raises:
        Exception: Any subclass that Python's unpickler raises for a broken file.
    """
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        _check_claims(content)
        content.seek(0)
        return _Unpickler(content).load()


def _check_claims(content: mmap.mmap) -> None:
    """Raise ValueError for stated lengths and indices that exceed the file.

    Python's unpickler allocates memory for any stated size. `pickletools.genops` checks lengths
    itself; the indices of memo entries are checked here.
    """
    for number, (code, argument, _) in enumerate(pickletools.genops(cast("IO[bytes]", content))):
        if code.name in _INDEXED and int(argument or 0) > number:
            raise ValueError(f"index {argument} after {number} steps")
