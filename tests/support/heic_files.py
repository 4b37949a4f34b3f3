"""HEIC pictures with a depth image beside them, as phones write them (ISO/IEC 23008-12).

`pillow-heif` writes pictures, and no depth images: a second picture of its file is made the first
one's auxiliary image here, with what the file says about its values (H.265, G.14.2.3).
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

_AUXILIARY = b"urn:mpeg:hevc:2015:auxid:2\0"
_PREFIX_SEI, _DEPTH_INFO = 39, 177


def heic_with_depth(
    picture: Any,
    grey: Any,
    kind: int | None,
    near: float = 0.0,
    far: float = 0.0,
    turns: bool = True,
    **more: Any,
) -> bytes:
    """A file with a picture (H, W, 3) RGB and the values (h, w) of its depth image.

    Args:
        picture: uint8.
        grey: uint8.
        kind: Of the values: 0 inverse depth, 1 disparity, 2 depth; None to say nothing.
        near: Nearest distance, or the smallest disparity.
        far: Farthest distance, or the largest disparity.
        turns: Whether the depth image is marked as turned and mirrored like the picture.
        more: For the encoder, such as `exif`.
    """
    import pillow_heif
    from PIL import Image

    pillow_heif.register_heif_opener()
    file = io.BytesIO()
    values = Image.fromarray(grey)
    Image.fromarray(picture).save(
        file, "HEIF", save_all=True, append_images=[values], quality=-1, **more
    )
    return _joined(file.getvalue(), b"" if kind is None else _said(kind, near, far), turns)


def _joined(data: bytes, said: bytes, turns: bool) -> bytes:
    """The file with its second picture as auxiliary image of the first."""
    boxes = dict(_boxes(data))
    meta = boxes[b"meta"]
    inner = dict(_boxes(meta[4:]))
    first, second = _items(inner[b"iinf"])[:2]
    properties = dict(_boxes(inner[b"iprp"]))
    kinds = [kind for kind, _ in _boxes(properties[b"ipco"])]
    turning = {number for number, kind in enumerate(kinds, 1) if kind in (b"irot", b"imir")}
    auxiliary = _box(b"auxC", bytes(4) + _AUXILIARY + said)
    properties[b"ipco"] += auxiliary
    properties[b"ipma"] = _associated(
        properties[b"ipma"], second, len(kinds) + 1, set() if turns else turning
    )
    inner[b"iprp"] = b"".join(_box(*each) for each in properties.items())
    reference = _box(b"auxl", struct.pack(">HHH", second, 1, first))
    inner[b"iref"] = inner.get(b"iref", bytes(4)) + reference
    old = len(meta)
    longer = meta[:4] + b"".join(_box(*each) for each in inner.items())
    inner[b"iloc"] = _moved(inner[b"iloc"], len(longer) - old)
    boxes[b"meta"] = meta[:4] + b"".join(_box(*each) for each in inner.items())
    return b"".join(_box(*each) for each in boxes.items())


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    place = 0
    while place + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, place)
        yield kind, data[place + 8 : place + size]
        place += size


def _box(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind) + content


def _items(iinf: bytes) -> list[int]:
    """The numbers of the pictures among the items."""
    entries = [entry for kind, entry in _boxes(iinf[6:]) if kind == b"infe"]
    return [struct.unpack_from(">H", entry, 4)[0] for entry in entries if entry[8:12] == b"hvc1"]


def _associated(ipma: bytes, item: int, number: int, less: set[int]) -> bytes:
    """The associations of properties with one more for an item, and less; numbers of one byte."""
    assert ipma[:4] == bytes(4)
    (count,) = struct.unpack_from(">I", ipma, 4)
    made, place = ipma[:8], 8
    for _ in range(count):
        of, has = struct.unpack_from(">HB", ipma, place)
        own = ipma[place + 3 : place + 3 + has]
        place += 3 + has
        if of == item:
            own = bytes(each for each in own if each & 0x7F not in less) + bytes([number])
        made += struct.pack(">HB", of, len(own)) + own
    return made


def _moved(iloc: bytes, by: int) -> bytes:
    """The places of the items in the file, moved; all of their numbers have four bytes."""
    assert (iloc[0], iloc[4], iloc[5]) == (0, 0x44, 0x40)
    made = bytearray(iloc)
    (count,) = struct.unpack_from(">H", iloc, 6)
    place = 8
    for _ in range(count):
        base, extents = struct.unpack_from(">IH", iloc, place + 4)
        struct.pack_into(">I", made, place + 4, base + by)
        place += 10 + 8 * extents
    return bytes(made)


def _said(kind: int, near: float, far: float) -> bytes:
    """The message "depth representation information" with its limits."""
    is_disparity = kind in (1, 3)
    bits = ("0011" if is_disparity else "1100") + _unsigned(kind)
    bits += _unsigned(0) if is_disparity else ""
    bits += _number(near) + _number(far)
    bits += "1"
    bits += "0" * (-len(bits) % 8)
    payload = int(bits, 2).to_bytes(len(bits) // 8, "big")
    message = bytes([_PREFIX_SEI << 1, 1, _DEPTH_INFO, len(payload)]) + payload
    unit = struct.pack(">I", len(message)) + message
    return struct.pack(">I", len(unit)) + unit


def _unsigned(value: int) -> str:
    """A number in Exp-Golomb code."""
    text = f"{value + 1:b}"
    return "0" * (len(text) - 1) + text


def _number(value: float) -> str:
    """A number above 0 as sign, exponent and mantissa of 16 bits."""
    mantissa, exponent = np.frexp(value)
    rest = round((2 * float(mantissa) - 1) * 2**16)
    return f"0{int(exponent) - 1 + 31:07b}{15:05b}{rest:016b}"
