"""Pictures and depth images."""

from __future__ import annotations

import cv2
import numpy as np

import calib
from basetree.files.reading import read_image
from formats.form import Format


def _pictures() -> tuple[bytes, ...]:
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    return tuple(
        cv2.imencode(suffix, image)[1].tobytes()
        for suffix in (".png", ".jpg", ".tif", ".bmp", ".webp", ".ppm")
    )


def _depth() -> bytes:
    return cv2.imencode(".png", np.arange(12, dtype=np.uint16).reshape(3, 4))[1].tobytes()


_HEADER = b"\x93NUMPY\x01\x00F\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }"

FORMATS = {
    "depth.png": Format((_depth(),), calib.read_depth),
    "depth.npy": Format((_HEADER.ljust(79) + b"\n" + bytes(16),), calib.read_depth),
    "picture": Format(_pictures(), read_image),
}
