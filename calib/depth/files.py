"""Read and write depth maps: 16-bit images with a scale, or floats in metres."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, Float32
from basetree.errors import InputFileError
from basetree.files.headers import heif
from basetree.files.headers.header import PictureHeader
from basetree.files.limits import current_limits
from basetree.files.npy import NPY_START, read_array_header
from basetree.files.picture_size import checked_header, most_picture_bytes
from basetree.files.reading import decode_image
from basetree.files.regular import open_regular, read_regular
from basetree.files.writing import write_image
from calib.depth.convention import check_scale, values_to_metres

_MM_PER_M = 1000.0
_MAX_MM = 65535
_METRE_BYTES = 4  # a float32
_ZIP = b"PK\x03\x04"  # how .npz begins
_JPEG, _EXR = b"\xff\xd8\xff", b"\x76\x2f\x31\x01"


def read_depth(path: Path | str, scale: float | None = None) -> Float32:
    """Read a depth map.

    Args:
        path: Single-channel PNG, TIFF or .npy file of integers or floating point, or a HEIF
            picture with a depth image of metres, told by its first bytes.
        scale: Metres per unit. By default integers are millimetres and floating point is metres.

    Returns:
        (H, W) float32 metres along z. Values that are not positive, not finite or too large for
        float32 become 0, no reading.

    Raises:
        InputFileError: If the file is missing, unreadable or larger than `Limits` allows.
        DepthError: If `scale` is not from 1e-6 to 1000, or the values are no depth: another type,
            several channels, 8 bits without a scale, or floating point that looks like millimetres.
    """
    path = Path(path)
    check_scale(scale, "scale")
    return values_to_metres(read_values(path), scale, str(path))


def in_millimetres(depth_m: Float) -> NDArray[np.uint16]:
    """Convert metres to whole millimetres; 0 for readings that are no number of 16 bits."""
    steps = np.where(np.isfinite(depth_m), np.rint(depth_m * _MM_PER_M), 0)
    return np.where((steps < 0) | (steps > _MAX_MM), 0, steps).astype(np.uint16)


def read_values(path: Path) -> NDArray[Any]:
    """Read the values of a picture or .npy file, whose first bytes say which it is.

    Raises:
        InputFileError: If the file is missing, unreadable or larger than `Limits` allows.
    """
    expected = "expected a depth map as PNG, TIFF or .npy"
    try:
        with open_regular(path) as file:
            is_array = file.read(len(NPY_START)) == NPY_START
            file.seek(0)
            if is_array:
                return _read_array(path, file)
        data = read_regular(path, most_picture_bytes())
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such file, {expected}") from error
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror}), {expected}") from error
    if data.startswith(_ZIP):
        raise InputFileError(f"{path}: several arrays, expected one (H, W) array of depth")
    if data.startswith(_EXR):
        raise InputFileError(
            f"{path}: OpenEXR, expected a depth map as PNG, TIFF or .npy: OpenCV reads it with"
            " OPENCV_IO_ENABLE_OPENEXR=1 set, and numpy.save writes .npy (docs/guides/phones.md)"
        )
    header = checked_header(data, str(path))
    if header is not None and header.format_name == heif.FORMAT_NAME:
        return _read_heif(path, data, header)
    image = decode_image(data, cv2.IMREAD_UNCHANGED, str(path))
    if image is not None and image.ndim == 2 and data.startswith(_JPEG):
        raise InputFileError(
            f"{path}: JPEG, whose compression changes depths and draws others beside edges:"
            " expected a depth map as PNG, TIFF or .npy, saved from the camera without JPEG"
        )
    if image is None and path.suffix.lower() == ".npy":
        raise _not_an_array(path)
    if image is None:
        raise InputFileError(f"{path}: not a readable image, expected a depth PNG or TIFF")
    _check_memory(path, image.size, image.nbytes)
    return image


def _read_heif(path: Path, data: bytes, header: PictureHeader) -> NDArray[Any]:
    """The depth image in a picture's file, metres."""
    holds = "no depth image" if header.depth is None else f"a depth image {header.depth.words}"
    _check_memory(path, header.width * header.height, len(data))
    is_metric = header.depth is not None and header.depth.is_metric
    depth_m = heif.decode_depth(data) if is_metric else None
    if depth_m is None:
        why = " that cannot be decoded" if is_metric else ""
        raise InputFileError(f"{path}: holds {holds}{why}, expected one with metres")
    return depth_m


def _read_array(path: Path, file: BinaryIO) -> NDArray[Any]:
    """The values of a .npy file, whose header is compared with what follows it."""
    try:
        header = read_array_header(file)
    except ValueError as error:
        raise _not_an_array(path) from error
    count = header.count
    if header.size_bytes > os.fstat(file.fileno()).st_size - file.tell():
        raise _not_an_array(path)
    largest = current_limits().image_pixels
    if count > largest:
        raise InputFileError(
            f"{path}: {count} values, expected at most {largest}, the limit image_pixels"
        )
    _check_memory(path, count, header.size_bytes)
    values = header.array(np.fromfile(file, header.dtype, count))
    return np.ascontiguousarray(values, values.dtype.newbyteorder("="))


def _not_an_array(path: Path) -> InputFileError:
    return InputFileError(f"{path}: not a readable .npy file, expected one (H, W) array of depth")


def _check_memory(path: Path, count: int, stored_bytes: int) -> None:
    """Refuse values that take too much memory together with their metres."""
    taken, most = stored_bytes + count * _METRE_BYTES, most_picture_bytes()
    if taken > most:
        raise InputFileError(
            f"{path}: {count} values take {taken / 1e6:.3g} MB with their metres, expected at most"
            f" {most / 1e6:.3g} MB, 5 bytes for each pixel of the limit image_pixels"
        )


def write_depth(path: Path | str, depth_m: Float) -> None:
    """Write (H, W) metres as a 16-bit PNG in millimetres.

    Readings that are not finite, negative or beyond 65.535 m are written as 0, no reading. The file
    is replaced atomically.

    Raises:
        InputFileError: If the file cannot be written.
    """
    write_image(Path(path), in_millimetres(depth_m))
