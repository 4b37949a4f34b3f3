"""Faults of a frame's picture files, and the signature by which pictures are compared."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perceptree.data.coco import FrameRecord

Signature = NDArray[np.uint64]

SIGNATURE_WORDS = 8
_SIDE = 16


def colour_faults(frame: FrameRecord) -> tuple[list[str], Signature | None]:
    """The kinds of fault of a frame's colour picture, and its signature where it can be read."""
    image, kind = _read(frame.image_path, cv2.IMREAD_COLOR)
    if image is None:
        return [f"image_{kind}"], None
    fits = image.shape[:2] == (frame.height, frame.width)
    return [] if fits else ["image_size"], signature(image)


def depth_faults(frame: FrameRecord) -> Iterator[tuple[str, Path]]:
    """(kind, file) of every fault of a frame's depth pictures: 8-bit, and 16-bit where named."""
    for path, dtype in ((frame.depth8_path, np.uint8), (frame.depth_path, np.uint16)):
        if path is None:
            continue
        image, kind = _read(path, cv2.IMREAD_UNCHANGED)
        if image is not None and (image.ndim != 2 or image.dtype != dtype):
            image, kind = None, "broken"
        if image is None:
            yield f"depth_{kind}", path
        elif image.shape != (frame.height, frame.width):
            yield "depth_size", path


def signature(image: NDArray[np.uint8]) -> Signature:
    """512 bits that hardly change when a picture (H, W, 3) is scaled, packed or brightened.

    The picture is averaged to 17x16 and 16x17 fields of grey; every bit says whether a field is
    brighter than the next one, in the rows of the first and the columns of the second (the
    difference hash of N. Krawetz, "Kind of Like That", 2013, in both directions and 16 wide).
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    wide = cv2.resize(grey, (_SIDE + 1, _SIDE), interpolation=cv2.INTER_AREA)
    high = cv2.resize(grey, (_SIDE, _SIDE + 1), interpolation=cv2.INTER_AREA)
    bits = np.concatenate([(wide[:, 1:] > wide[:, :-1]).ravel(), (high[1:] > high[:-1]).ravel()])
    return np.packbits(bits).view(np.uint64)


def _read(path: Path, flag: int) -> tuple[NDArray[Any] | None, str]:
    """The decoded picture, or None and whether it is missing or broken."""
    try:
        data = path.read_bytes()
    except OSError:
        return None, "missing"
    if not data or not _is_whole(data):
        return None, "broken"
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flag)
    except cv2.error:
        image = None
    return (None, "broken") if image is None else (np.asarray(image), "")


def _is_whole(data: bytes) -> bool:
    """Whether a JPEG or PNG has its end mark: OpenCV 4 fills in silently what was cut off."""
    if data.startswith(b"\xff\xd8"):
        return data.rfind(b"\xff\xd9") > len(data) // 2
    return not data.startswith(b"\x89PNG") or b"IEND" in data[-64:]
