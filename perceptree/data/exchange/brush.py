"""Unpack the masks that Label Studio stores for its brush.

The bytes are a stream of bits, most significant first: the number of values in 32 bits, the size of
a value less 1 in 5, four sizes of lengths less 1 in 4 each; then runs. A run is 1 bit that says
whether one value repeats, 2 bits that choose a size, a length less 1 of that size, and the value,
or the values. The values are the bytes of RGBA pixels, of which alpha is the mask.
"""

from __future__ import annotations

import numpy as np

from basetree.arrays import Bool

_CHANNELS = 4


class _Bits:
    def __init__(self, data: bytes) -> None:
        self._bits = np.unpackbits(np.frombuffer(data, np.uint8))
        self._at = 0

    def take(self, count: int) -> int:
        """Return the number in the next bits."""
        return int("".join(map(str, self.take_many(1, count)[0])), 2)

    def take_many(self, values: int, count: int) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
        """Return the bits (values, count) of several numbers."""
        end = self._at + values * count
        if end > len(self._bits):
            raise ValueError("it ends early")
        bits = self._bits[self._at : end].reshape(values, count)
        self._at = end
        return bits


def unpack_brush(data: bytes, pixels: int) -> Bool:
    """Unpack a mask.

    Args:
        data: The packed bytes.
        pixels: Number of pixels of the picture.

    Returns:
        (pixels,) bool, row by row.

    Raises:
        ValueError: If the data is not such a mask of so many pixels.
    """
    bits = _Bits(data)
    if bits.take(32) != pixels * _CHANNELS:
        raise ValueError(f"expected {pixels} pixels of {_CHANNELS} bytes")
    word = bits.take(5) + 1
    if word != 8:
        raise ValueError(f"values have {word} bits, expected 8")
    sizes = [bits.take(4) + 1 for _ in range(4)]
    values = np.zeros(pixels * _CHANNELS, np.uint8)
    at = 0
    while at < len(values):
        repeats = bits.take(1)
        end = at + bits.take(sizes[bits.take(2)]) + 1
        if end > len(values):
            raise ValueError("it is too long")
        if repeats:
            values[at:end] = bits.take(word)
        else:
            values[at:end] = np.packbits(bits.take_many(end - at, word), axis=1)[:, 0]
        at = end
    return np.asarray(values[_CHANNELS - 1 :: _CHANNELS] > 0)
