"""HEIF pictures with HEVC, as phones write them, by `pillow-heif` of the extra `heic`.

pillow-heif and not own code: HEVC is a video codec. The size is read without decoding.
Format: ISO/IEC 23008-12 (HEIF), ISO/IEC 14496-12 (boxes).
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from basetree.errors import install_hint
from basetree.files.headers.exif import INVERSE, UPRIGHT, read_focal_px, turned_upright
from basetree.files.headers.header import NotOffered, PictureHeader
from basetree.files.headers.heif_depth import depth_metres, depth_note

FORMAT_NAME = "HEIF"
_BYTES_PER_PX = 8  # of the decoder, which holds the picture in planes and in colours
_MOST_BOXES = 10_000


def is_readable() -> bool:
    """Whether the package that decodes HEIF is installed."""
    return find_spec("pillow_heif") is not None


def read_header(data: bytes) -> PictureHeader | None:
    """Read the header; None if the file is damaged or holds something else.

    Raises:
        NotOffered: pillow-heif is not installed.
    """
    picture = _opened(data)
    if picture is None:
        return None
    orientation = _orientation(data)
    width, height = picture.size
    if orientation in (5, 6, 7, 8):
        width, height = height, width
    exif = (picture.info.get("exif") or b"").removeprefix(b"Exif\0\0")
    return PictureHeader(
        FORMAT_NAME,
        width,
        height,
        3,
        decoder_bytes=width * height * _BYTES_PER_PX,
        orientation=orientation,
        focal_px=read_focal_px(exif, width, height),
        depth=depth_note(picture, orientation),
    )


def decode(data: bytes) -> NDArray[np.uint8] | None:
    """The pixels as the camera stored them, (H, W, 3) BGR; None if they cannot be decoded."""
    picture = _opened(data)
    if picture is None:
        return None
    try:
        pixels = np.asarray(picture)
    except (OSError, ValueError, RuntimeError, EOFError, SyntaxError):
        return None
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=2)
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] < 3:
        return None
    orientation = _orientation(data)
    stored = turned_upright(pixels[..., 2::-1], INVERSE.get(orientation, orientation))
    return np.ascontiguousarray(stored)


def decode_depth(data: bytes) -> NDArray[np.float32] | None:
    """The depth image of a file whose header says that it has metres, in the stored pixels.

    Returns:
        (H, W) metres, 0 for no reading; None if it cannot be decoded.
    """
    picture = _opened(data)
    return None if picture is None else depth_metres(picture, _orientation(data))


def _opened(data: bytes) -> Any:
    """The main picture of a file, not yet decoded; None if the file is damaged."""
    try:
        import pillow_heif
    except ImportError as error:
        raise NotOffered(
            f"a HEIF picture, which needs pillow-heif: {install_hint('heic')}, or export JPEG or"
            " PNG"
        ) from error
    try:
        return pillow_heif.open_heif(io.BytesIO(data))[0]
    except (OSError, ValueError, RuntimeError, EOFError, SyntaxError, IndexError):
        return None


def _orientation(data: bytes) -> int:
    """The EXIF orientation that the turn and the mirror in the file stand for.

    The decoder applies both, and EXIF's own orientation has no meaning in HEIF.
    """
    turns, mirrors = set(), set()
    for kind, content in _properties(data):
        if kind == b"irot" and content:
            turns.add(content[0] & 3)
        elif kind == b"imir" and content:
            mirrors.add(content[0] & 1)
    turn, mirror = max(turns, default=0), max(mirrors, default=None)
    stored = np.arange(6).reshape(2, 3)
    upright = np.rot90(stored, turn)
    if mirror is not None:
        upright = upright[:, ::-1] if mirror else upright[::-1]
    for orientation in range(1, 9):
        if np.array_equal(turned_upright(stored, orientation), upright):
            return orientation
    return UPRIGHT


def _properties(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of the boxes of properties: those in meta, iprp, ipco."""
    try:
        for kind, meta in _boxes(data):
            if kind == b"meta":
                for inner, properties in _boxes(meta[4:]):  # after its version and flags
                    if inner == b"iprp":
                        for innermost, container in _boxes(properties):
                            if innermost == b"ipco":
                                yield from _boxes(container)
    except struct.error:  # it ends early
        return


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    position = 0
    for _ in range(_MOST_BOXES):
        if position + 8 > len(data):
            return
        size, kind = struct.unpack_from(">I4s", data, position)
        head = 8
        if size == 1:
            (size,) = struct.unpack_from(">Q", data, position + 8)
            head = 16
        end = len(data) if size == 0 else position + size
        if end < position + head:
            return
        yield kind, data[position + head : end]
        position = end
