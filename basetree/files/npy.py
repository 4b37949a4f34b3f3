"""Arrays as numpy saves them (.npy), from files of others: numbers alone, never objects."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

NPY_START: Final = b"\x93NUMPY"
"""How such files begin."""

_HEADERS: Final = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_MOST_AXES: Final = 32  # of numpy


@dataclass(frozen=True)
class ArrayHeader:
    """What the header of an array states.

    Attributes:
        shape: Its shape.
        is_fortran: Whether the first axis varies fastest in the file.
        dtype: Type of the numbers, or of records of numbers.
    """

    shape: tuple[int, ...]
    is_fortran: bool
    dtype: np.dtype[Any]

    @property
    def count(self) -> int:
        """Number of values."""
        return math.prod(self.shape)

    @property
    def size_bytes(self) -> int:
        """Bytes that follow the header."""
        return self.count * self.dtype.itemsize

    def array(self, values: NDArray[Any]) -> NDArray[Any]:
        """The array of values in the order of the file."""
        return values.reshape(self.shape, order="F" if self.is_fortran else "C")


def read_array_header(file: BinaryIO) -> ArrayHeader:
    """Read the header of an array of numbers; the values follow.

    Args:
        file: The open file, at its beginning.

    Raises:
        ValueError: If it is no such header, or one of objects, which would need pickle.
    """
    try:
        version = np.lib.format.read_magic(file)
        header = ArrayHeader(*_HEADERS[version](file))
    except Exception as error:  # numpy parses the header as Python: many kinds of errors
        raise ValueError("not the header of an array") from error
    shape, dtype = header.shape, header.dtype
    is_plain = dtype.itemsize > 0 and not dtype.hasobject and len(shape) <= _MOST_AXES
    # An item of a subtype holds several numbers, which the shape does not count.
    if not is_plain or dtype.subdtype is not None or min(shape, default=0) < 0:
        raise ValueError("not an array of numbers")
    return header
