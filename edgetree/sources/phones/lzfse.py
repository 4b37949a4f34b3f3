"""LZFSE, the compression of Record3D's depth: what its blocks state, and unpacking with a package.

The blocks of the format and their fields are those of Apple's reference implementation.
"""

from __future__ import annotations

import struct
from typing import Final

from basetree.errors import InputError, MissingPackage, install_hint

_MAGIC_BYTES: Final = 4
_END, _RAW, _FULL, _SHORT, _OTHER = b"bvx$", b"bvx-", b"bvx1", b"bvx2", b"bvxn"
_FULL_HEADER_BYTES: Final = 772
_MOST_BLOCKS: Final = 100_000


def unpacked_bytes(data: bytes) -> int:
    """Number of bytes that LZFSE data unpacks to, as its blocks state.

    Raises:
        InputError: It is no LZFSE, or is cut off.
    """
    total = at = 0
    for _ in range(_MOST_BLOCKS):
        magic = data[at : at + _MAGIC_BYTES]
        if magic == _END:
            return total
        try:
            (raw,) = struct.unpack_from("<I", data, at + 4)
            size = _block_bytes(magic, data, at, raw)
        except struct.error as error:
            raise InputError("it is cut off: expected LZFSE with its end") from error
        total, at = total + raw, at + size
    raise InputError(f"it has more than {_MOST_BLOCKS} blocks: expected fewer")


def _block_bytes(magic: bytes, data: bytes, at: int, raw: int) -> int:
    """Size of a block with its header."""
    if magic == _RAW:
        return 8 + raw
    if magic == _OTHER:
        (payload,) = struct.unpack_from("<I", data, at + 8)
        return 12 + int(payload)
    if magic == _FULL:
        (payload,) = struct.unpack_from("<I", data, at + 8)
        return _FULL_HEADER_BYTES + int(payload)
    if magic == _SHORT:
        literals, distances, header = struct.unpack_from("<3Q", data, at + 8)
        payload = (literals >> 20 & 0xFFFFF) + (distances >> 40 & 0xFFFFF)
        return int((header & 0xFFFFFFFF) + payload)
    raise InputError(f"it has a block {magic!r}: expected LZFSE")


def unpack(data: bytes, expected: int) -> bytes:
    """Unpack LZFSE data of a known size.

    Args:
        data: The data.
        expected: Number of bytes that it unpacks to.

    Raises:
        InputError: It is no LZFSE, is damaged, or unpacks to another number of bytes.
        MissingPackage: The package is not installed.
    """
    stated = unpacked_bytes(data)
    if stated != expected:
        raise InputError(f"it unpacks to {stated} bytes: expected {expected}")
    try:
        import lzfse
    except ImportError as error:
        raise MissingPackage(
            f"lzfse is not installed, which depth of Record3D needs: {install_hint('phone')}"
        ) from error
    try:
        found = lzfse.decompress(data)
    except lzfse.error as error:
        raise InputError("it is damaged: expected LZFSE") from error
    if len(found) != expected:
        raise InputError(f"it unpacks to {len(found)} bytes: expected {expected}")
    return bytes(found)
