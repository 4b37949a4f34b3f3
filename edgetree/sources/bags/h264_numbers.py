"""Notice lost pictures of H.264, which decoders replace by others without a word.

Pictures that others refer to are numbered in the headers of their slices (`frame_num` in ITU-T
H.264, 7.3.2.1, 7.3.3 and 7.4.3). H.265 needs no help: its decoder refuses pictures without theirs.
"""

from __future__ import annotations

import re
from itertools import islice
from typing import Final

_START: Final = re.compile(b"\0\0\1")
_SLICE, _KEY_SLICE, _SETTINGS = 1, 5, 7  # kinds of units
# Profiles whose settings have fields of their own before the numbers.
_HIGH: Final = frozenset((44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 144, 244))
_HEADER_BYTES: Final = 64
_MOST_UNITS: Final = 64  # before the first slice of a picture


class FrameNumbers:
    """Follows the numbers of one stream's pictures."""

    def __init__(self) -> None:
        self._bits: int | None = None  # of a number; None if numbers may be left out, or not read
        self._last: int | None = None

    def is_gap(self, packet: bytes) -> bool:
        """Whether pictures are missing between the packet before and this one."""
        for match in islice(_START.finditer(packet), _MOST_UNITS):
            header = packet[match.end() : match.end() + _HEADER_BYTES]
            kind = header[0] & 31 if header else 0
            if kind == _SETTINGS:
                self._bits = _bits_of_numbers(_Fields(header[1:]))
            elif kind in (_SLICE, _KEY_SLICE):
                return self._follow(header, is_key=kind == _KEY_SLICE)
        return False

    def _follow(self, header: bytes, *, is_key: bool) -> bool:
        if self._bits is None:
            return False
        fields = _Fields(header[1:])
        fields.skip(3)  # the slice's place, its type, and its parameters
        number, last = fields.bits(self._bits), self._last
        is_reference = bool(header[0] & 0x60)
        self._last = number if is_reference or last is None else last
        return not is_key and last is not None and (number - last) % 2**self._bits > 1


def _bits_of_numbers(fields: _Fields) -> int | None:
    """The length of the numbers; None if the stream may leave numbers out or lists scalings."""
    profile = fields.bits(24) >> 16
    fields.number()
    if profile in _HIGH:
        is_444 = fields.number() == 3
        fields.bits(is_444)
        fields.skip(2)
        if fields.bits(2) & 1:
            return None
    length = fields.number() + 4
    order = fields.number()
    if order == 0:
        fields.number()
    elif order == 1:
        fields.bits(1)
        fields.skip(2)
        fields.skip(min(fields.number(), 8 * _HEADER_BYTES))
    fields.number()
    return None if fields.bits(1) or length > 16 else length


class _Fields:
    """Reads fields of bits and Exp-Golomb numbers; zeros after the end."""

    def __init__(self, data: bytes) -> None:
        plain = data.replace(b"\0\0\3", b"\0\0")
        self._value, self._left = int.from_bytes(plain, "big"), 8 * len(plain)

    def bits(self, count: int) -> int:
        self._left -= count
        shift = self._left
        return (self._value >> shift if shift >= 0 else 0) & ((1 << count) - 1)

    def number(self) -> int:
        zeros = 0
        while self._left > 0 and not self.bits(1):
            zeros += 1
        return (1 << zeros) - 1 + self.bits(zeros)

    def skip(self, count: int) -> None:
        for _ in range(count):
            self.number()
