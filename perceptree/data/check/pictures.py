"""Check a frame's image files, and compute signatures to compare images."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import UInt8
from basetree.errors import InputFileError
from basetree.files.picture_size import most_picture_bytes
from basetree.files.reading import Picture, decode_picture
from basetree.files.regular import read_regular
from perceptree.data.coco import FrameRecord
from perceptree.data.orientation import as_labelled, how_labelled

Signature = NDArray[np.uint64]

SIGNATURE_WORDS = 8
_HASH_SIDE = 16


def colour_faults(frame: FrameRecord) -> tuple[list[str], Signature | None, str]:
    """Check a frame's colour image.

    Returns:
        Kinds of problems, the image's signature, None if it cannot be read, and how an EXIF
        orientation is taken, a key of `ORIENTED`.
    """
    picture, kind = _read(frame.image_path, cv2.IMREAD_COLOR)
    if picture is None:
        return [f"image_{kind}"], None, ""
    image = as_labelled(picture, frame)
    faults = [] if image.shape[:2] == (frame.height, frame.width) else ["image_size"]
    return faults, signature(np.asarray(image, np.uint8)), how_labelled(picture, frame)


def depth_faults(frame: FrameRecord) -> Iterator[tuple[str, Path]]:
    """Yield (kind, file) of every problem of a frame's 8-bit and 16-bit depth images."""
    for path, dtype in ((frame.depth8_path, np.uint8), (frame.depth_path, np.uint16)):
        if path is None:
            continue
        picture, kind = _read(path, cv2.IMREAD_UNCHANGED)
        image = None if picture is None else as_labelled(picture, frame)
        if image is not None and (image.ndim != 2 or image.dtype != dtype):
            image, kind = None, "broken"
        if image is None:
            yield f"depth_{kind}", path
        elif image.shape != (frame.height, frame.width):
            yield "depth_size", path


def signature(image: UInt8) -> Signature:
    """Compute a perceptual hash that hardly changes with scaling, compression or brightness.

    The difference hash of N. Krawetz ("Kind of Like That", 2013), 16 wide and in both directions:
    the image is averaged to 17x16 and 16x17 cells, and each bit says whether a cell is brighter
    than the one before it in its row (first grid) or column (second grid).

    Args:
        image: (H, W, 3) BGR uint8.

    Returns:
        (8,) uint64, 512 bits.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    wide = cv2.resize(grey, (_HASH_SIDE + 1, _HASH_SIDE), interpolation=cv2.INTER_AREA)
    high = cv2.resize(grey, (_HASH_SIDE, _HASH_SIDE + 1), interpolation=cv2.INTER_AREA)
    bits = np.concatenate([(wide[:, 1:] > wide[:, :-1]).ravel(), (high[1:] > high[:-1]).ravel()])
    return np.packbits(bits).view(np.uint64)


def _read(path: Path, flag: int) -> tuple[Picture | None, str]:
    """Return the decoded picture, or None and "missing" or "broken"."""
    try:
        data = read_regular(path, most_picture_bytes())
    except OSError:
        return None, "missing"
    try:
        picture = decode_picture(data, flag) if _is_whole(data) else None
    except InputFileError:
        picture = None
    return (None, "broken") if picture is None else (picture, "")


def _is_whole(data: bytes) -> bool:
    """Return whether a JPEG has its end marker; OpenCV 4 does not report truncation."""
    if data.startswith(b"\xff\xd8"):
        return data.rfind(b"\xff\xd9") > len(data) // 2
    return True
