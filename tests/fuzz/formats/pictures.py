"""Pictures, masks and depth images."""

from __future__ import annotations

import io
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
from heic_files import heic_with_depth

import calib
from basetree.files import check_picture_size
from basetree.files.picture_size import file_picture_size, has_deep_grey
from basetree.files.reading import is_image_file, orientation_note, read_picture
from edgetree.frames.images import read_colour, read_masks
from formats.form import Format
from perceptree.simulator.photographs.loading import read_picture as read_texture

_GREY = np.arange(48, dtype=np.uint8).reshape(6, 8)
_COLOUR = np.dstack([_GREY, _GREY * 2, _GREY * 3])
_DEPTH = _GREY.astype(np.uint16) * 100
_EXIF = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
# A directory that leads to another one, with a 35 mm equivalent of 26 mm.
_FOCAL = (
    b"II*\0\x08\0\0\0\x01\0\x69\x87\x04\0\x01\0\0\0\x1a\0\0\0\0\0\0\0"
    b"\x01\0\x05\xa4\x03\0\x01\0\0\0\x1a\0\0\0\0\0\0\0"
)
_HEADER = b"\x93NUMPY\x01\x00F\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }"
_TEXTURE_PX = 64


def _encoded(suffix: str, image: np.ndarray, *options: int) -> bytes:
    data: bytes = cv2.imencode(suffix, image, options)[1].tobytes()
    return data


def _jpeg_with(exif: bytes) -> bytes:
    plain = _encoded(".jpg", _COLOUR)
    segment = b"Exif\0\0" + exif
    return plain[:2] + b"\xff\xe1" + (len(segment) + 2).to_bytes(2, "big") + segment + plain[2:]


_PICTURES = (
    *(_encoded(suffix, _COLOUR) for suffix in (".png", ".jpg", ".tif", ".bmp", ".webp", ".ppm")),
    _encoded(".jpg", _COLOUR, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    _encoded(".tif", _COLOUR, cv2.IMWRITE_TIFF_COMPRESSION, 1),
    _encoded(".webp", _COLOUR, cv2.IMWRITE_WEBP_QUALITY, 101),
    _encoded(".gif", _COLOUR),
    _encoded(".pgm", _GREY),
    b"P2 8 6 255 " + b" ".join(b"%d" % value for value in _GREY.flat) + b"\n",
    b"P4 8 6\n" + bytes(6),
    _jpeg_with(_EXIF),
    _jpeg_with(_FOCAL),
)


def _heic() -> tuple[bytes, ...]:
    """Pictures in HEIF, plain and turned; none without the package that writes them."""
    if find_spec("pillow_heif") is None:
        return ()
    import pillow_heif
    from PIL import Image

    pillow_heif.register_heif_opener()
    files = []
    for orientation in (1, 5):
        exif, file = Image.Exif(), io.BytesIO()
        exif[274] = orientation
        big = np.repeat(np.repeat(_COLOUR, 8, 0), 8, 1)
        Image.fromarray(big).save(file, "HEIF", exif=exif.tobytes())
        files.append(file.getvalue())
    return tuple(files)


def _heic_depth() -> tuple[bytes, ...]:
    """HEIF with depth images in metres; none without the package that writes them."""
    if find_spec("pillow_heif") is None:
        return ()
    big, grey = np.repeat(np.repeat(_COLOUR, 8, 0), 8, 1), np.full((24, 32), 90, np.uint8)
    return tuple(heic_with_depth(big, grey, kind, 0.5, 5.0) for kind in (0, 2))


_DEPTHS = (
    _encoded(".png", _DEPTH),
    _encoded(".tif", _DEPTH),
    _encoded(".tif", _DEPTH.astype(np.float32) / 1000),
    _encoded(".pfm", _DEPTH.astype(np.float32) / 1000),
    _encoded(".pgm", _DEPTH),
)
_TEXTURE = np.full((_TEXTURE_PX, _TEXTURE_PX, 3), 90, np.uint8)


def _read_everything(path: Path) -> object:
    """What is asked of a picture beside its pixels, and its pixels."""
    is_image_file(path)
    orientation_note(path)
    check_picture_size(path)
    file_picture_size(path)
    has_deep_grey(path)
    picture = read_picture(path, cv2.IMREAD_UNCHANGED)
    return None if picture is None else picture.upright()


FORMATS = {
    "depth.png": Format(_DEPTHS, calib.read_depth),
    "depth.npy": Format((_HEADER.ljust(79) + b"\n" + bytes(16),), calib.read_depth),
    "picture": Format(_PICTURES, _read_everything),
    "colour": Format(_PICTURES, read_colour),
    **({"picture.heic": Format(heic, _read_everything)} if (heic := _heic()) else {}),
    **({"depth.heic": Format(heic, calib.read_depth)} if (heic := _heic_depth()) else {}),
    "mask.png": Format(
        (_encoded(".png", _GREY), _encoded(".tif", _DEPTH), _encoded(".bmp", _GREY)),
        lambda path: read_masks(path, (8, 6)),
    ),
    "texture": Format((_encoded(".png", _TEXTURE), _encoded(".jpg", _TEXTURE)), read_texture),
}
