"""Formats with a short header and plain pixels: BMP, PNM, PFM; and GIF."""

from __future__ import annotations

import re
import struct

from basetree.files.headers.header import PictureHeader

_BMP_OLD_HEADER, _BMP_SHORTEST_HEADER = 12, 36
_BMP_BITS = (1, 2, 4, 8, 16, 24, 32)
_BMP_PACKED = (1, 2)  # run-length encodings
_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_NUMBER = rb"(\d{1,9})"
_BITMAP = re.compile(rb"P[14]" + _GAP + _NUMBER + _GAP + _NUMBER + rb"\s")
_GREY_OR_COLOUR = re.compile(
    rb"P[2356]" + _GAP + _NUMBER + _GAP + _NUMBER + _GAP + _NUMBER + rb"\s"
)
_PFM = re.compile(rb"P[Ff]\s" + _NUMBER + rb"\s" + _NUMBER + rb"\s([-+.\deE]{1,30})\s")
_LONGEST_PNM_HEADER = 4096
_GIF_DECODER_BYTES = 10  # for a pixel


def read_bmp(data: bytes) -> PictureHeader | None:
    """Read the header of a Windows or OS/2 bitmap."""
    start, header = struct.unpack_from("<II", data, 10)
    packing = 0
    if header == _BMP_OLD_HEADER:
        width, height, _, bits = struct.unpack_from("<HHHH", data, 18)
    elif header >= _BMP_SHORTEST_HEADER:
        width, height, _, bits, packing = struct.unpack_from("<iiHHI", data, 18)
        width, height = abs(width), abs(height)
    else:
        return None
    if bits not in _BMP_BITS:
        return None
    row_bytes = (width * bits + 31) // 32 * 4
    is_whole = packing in _BMP_PACKED or start + row_bytes * height <= len(data)
    return PictureHeader("BMP", width, height, 4 if bits == 32 else 3, is_whole=is_whole)


def read_gif(data: bytes) -> PictureHeader | None:
    """Read the logical screen of a GIF, on which all its pictures are drawn."""
    width, height = struct.unpack_from("<HH", data, 6)
    return PictureHeader("GIF", width, height, 4, 1, width * height * _GIF_DECODER_BYTES)


def read_pnm(data: bytes) -> PictureHeader | None:
    """Read the header of PBM, PGM and PPM, as text or binary."""
    start = data[:_LONGEST_PNM_HEADER]
    is_bitmap = data[1:2] in b"14"
    found = (_BITMAP if is_bitmap else _GREY_OR_COLOUR).match(start)
    if found is None:
        return None
    width, height = int(found[1]), int(found[2])
    samples = 3 if data[1:2] in b"36" else 1
    deep = not is_bitmap and int(found[3]) > 255
    if data[1:2] in b"123":
        least = width * height * samples * (1 if is_bitmap else 2) - 1
    elif is_bitmap:
        least = (width + 7) // 8 * height
    else:
        least = width * height * samples * (2 if deep else 1)
    is_whole = found.end() + least <= len(data)
    return PictureHeader("PNM", width, height, samples, 2 if deep else 1, is_whole=is_whole)


def read_pfm(data: bytes) -> PictureHeader | None:
    """Read the header of a portable float map."""
    found = _PFM.match(data[:_LONGEST_PNM_HEADER])
    if found is None:
        return None
    width, height = int(found[1]), int(found[2])
    samples = 3 if data[1:2] == b"F" else 1
    return PictureHeader(
        "PFM",
        width,
        height,
        samples,
        sample_bytes=4,
        decoder_bytes=4 * width * height * samples,
        is_whole=found.end() + 4 * width * height * samples <= len(data),
    )
