"""Picture files made byte by byte: headers that state anything, with few pixels behind them."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable

import cv2
import numpy as np

_FORMATS = {1: "B", 3: "H", 4: "I", 16: "Q"}


def png_chunk(kind: bytes, data: bytes, length: int | None = None) -> bytes:
    """A chunk, which may state another length than it has."""
    stated = len(data) if length is None else length
    return struct.pack(">I", stated) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(*chunks: bytes, size: tuple[int, int] = (8, 6), bits: int = 8, colour: int = 0) -> bytes:
    """A PNG of these chunks between its header and its end."""
    header = struct.pack(">IIBBBBB", *size, bits, colour, 0, 0, 0)
    parts = (png_chunk(b"IHDR", header), *chunks, png_chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def png_of_zeros(width: int, height: int, bits: int = 1, colour: int = 0) -> bytes:
    """A PNG of zeros in about a thousandth of its pixels' bytes."""
    samples = {0: 1, 2: 3, 6: 4}[colour]
    packer = zlib.compressobj(9)
    row = bytes(1 + (width * samples * bits + 7) // 8)
    rows = b"".join(packer.compress(row) for _ in range(height)) + packer.flush()
    return png(png_chunk(b"IDAT", rows), size=(width, height), bits=bits, colour=colour)


def exif(orientation: int, order: str = ">") -> bytes:
    """EXIF metadata that state an orientation."""
    mark = b"MM\0*" if order == ">" else b"II*\0"
    entry = struct.pack(f"{order}HHIHH", 274, 3, 1, orientation, 0)
    return mark + struct.pack(f"{order}IH", 8, 1) + entry + bytes(4)


def jpeg_segment(marker: int, data: bytes) -> bytes:
    """A segment of a JPEG."""
    return struct.pack(">BBH", 0xFF, marker, len(data) + 2) + data


def jpeg(image: np.ndarray, *segments: bytes, options: Iterable[int] = ()) -> bytes:
    """A JPEG with these segments at its beginning."""
    data: bytes = cv2.imencode(".jpg", image, list(options))[1].tobytes()
    return data[:2] + b"".join(segments) + data[2:]


def with_jpeg_size(data: bytes, width: int, height: int) -> bytes:
    """A JPEG whose frame header states another size."""
    at = max(data.find(b"\xff\xc0"), data.find(b"\xff\xc2"))
    return data[: at + 5] + struct.pack(">HH", height, width) + data[at + 9 :]


def tiff(
    entries: dict[int, tuple[int, list[int]]],
    pixels: bytes = b"",
    *,
    order: str = "<",
    big: bool = False,
    gap: int = 0,
) -> bytes:
    """A TIFF with one directory behind the pixels and a gap.

    Args:
        entries: (type, values) of each tag.
        pixels: The bytes of the strips, at 16.
        order: "<" or ">".
        big: Whether it is a BigTIFF.
        gap: Bytes before the directory.
    """
    mark = b"II" if order == "<" else b"MM"
    start, entry, inline = ("Q", "HHQ", 8) if big else ("I", "HHI", 4)
    body = pixels + bytes(gap)
    rows = []
    for tag in sorted(entries):
        kind, values = entries[tag]
        data = struct.pack(f"{order}{len(values)}{_FORMATS[kind]}", *values)
        if len(data) > inline:
            at = 16 + len(body)
            body, data = body + data, struct.pack(order + start, at)
        rows.append(struct.pack(order + entry, tag, kind, len(values)) + data.ljust(inline, b"\0"))
    directory = struct.pack(order + ("Q" if big else "H"), len(rows)) + b"".join(rows)
    version = struct.pack(f"{order}HHH", 43, 8, 0) if big else struct.pack(f"{order}H", 42)
    header = mark + version + struct.pack(order + start, 16 + len(body))
    return header.ljust(16, b"\0") + body + directory + struct.pack(order + start, 0)


def tiff_of(
    image: np.ndarray, order: str = "<", big: bool = False, gap: int = 0, **tags: int
) -> bytes:
    """A TIFF of one strip of an (H, W) or (H, W, 3) image, with tags named such as `tag_274`."""
    height, width = image.shape[:2]
    channels = 1 if image.ndim == 2 else image.shape[2]
    pixels = image[..., ::-1] if channels == 3 else image
    data = pixels.astype(image.dtype.newbyteorder(order)).tobytes()
    entries = {
        256: (4, [width]),
        257: (4, [height]),
        258: (3, [image.dtype.itemsize * 8] * channels),
        259: (3, [1]),
        262: (3, [2 if channels == 3 else 1]),
        273: (4, [16]),
        277: (3, [channels]),
        278: (4, [height]),
        279: (4, [len(data)]),
    }
    entries |= {int(name[4:]): (4 if tag > 65535 else 3, [tag]) for name, tag in tags.items()}
    return tiff(entries, data, order=order, big=big, gap=gap)


def webp_with_exif(image: np.ndarray, metadata: bytes) -> bytes:
    """An extended WebP: canvas, picture and EXIF metadata."""
    height, width = image.shape[:2]
    plain: bytes = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, 101])[1].tobytes()
    canvas = bytes([8, 0, 0, 0]) + (width - 1).to_bytes(3, "little")
    canvas += (height - 1).to_bytes(3, "little")
    body = b"WEBPVP8X" + struct.pack("<I", len(canvas)) + canvas + plain[12:]
    body += b"EXIF" + struct.pack("<I", len(metadata)) + metadata + bytes(len(metadata) % 2)
    return b"RIFF" + struct.pack("<I", len(body)) + body
