"""Read and write depth maps: 16-bit images with a scale, or floats in metres."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, Float32
from basetree.errors import InputFileError
from basetree.files.limits import current_limits
from basetree.files.picture_size import most_picture_bytes
from basetree.files.reading import decode_image
from basetree.files.regular import open_regular, read_regular
from basetree.files.writing import write_image
from calib.errors import DepthError

_MM_PER_M = 1000.0
_MAX_MM = 65535
_MAX_READING_M = float(np.finfo(np.float32).max)
_METRE_BYTES = 4  # a float32
_ZIP = b"PK\x03\x04"  # how .npz begins
_NPY = b"\x93NUMPY"
_NPY_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_depth(path: Path | str, scale: float = 1 / _MM_PER_M) -> Float32:
    """Read a depth map.

    Args:
        path: Single-channel PNG, TIFF or .npy file, told by its first bytes. uint16 values are
            multiplied by `scale`; float32 and float64 values are metres.
        scale: Metres per step of a uint16 file; the default is millimetres.

    Returns:
        (H, W) float32 metres along z. Values that are not positive, not finite or too large for
        float32 become 0, no reading.

    Raises:
        InputFileError: If the file is missing, unreadable or larger than `Limits` allows.
        DepthError: If `scale` is not positive, or the file has another dtype or several channels.
    """
    path = Path(path)
    if not (math.isfinite(scale) and scale > 0):
        raise DepthError(f"scale is {scale}: expected metres per step, above 0")
    values = _read_values(path)
    channels = 1 if values.ndim == 2 else values.shape[-1] if values.ndim == 3 else 0
    if channels != 1 or values.dtype not in (np.uint16, np.float32, np.float64):
        raise DepthError(
            f"{path}: {channels} channel(s) of {values.dtype}, expected one channel of uint16"
            f" in steps of {scale:g} m or of float32 in metres"
        )
    values = values.reshape(values.shape[:2])
    if values.dtype == np.uint16:
        return in_metres(values, scale)
    no_reading = ~((values > 0) & (values <= _MAX_READING_M))
    values[no_reading] = 0
    return values.astype(np.float32, copy=False)


def in_metres(steps: NDArray[Any], scale: float) -> Float32:
    """Convert uint16 steps to metres.

    If 1 / scale is a whole number, divide by it: the result is then the float32 nearest to the
    exact value.
    """
    per_m = 1 / scale
    if abs(per_m - round(per_m)) < 1e-6 * per_m:
        return np.divide(steps, np.float32(round(per_m)), dtype=np.float32)
    return np.multiply(steps, np.float32(scale), dtype=np.float32)


def in_millimetres(depth_m: Float) -> NDArray[np.uint16]:
    """Convert metres to whole millimetres; 0 for readings that are no number of 16 bits."""
    steps = np.where(np.isfinite(depth_m), np.rint(depth_m * _MM_PER_M), 0)
    return np.where((steps < 0) | (steps > _MAX_MM), 0, steps).astype(np.uint16)


def _read_values(path: Path) -> NDArray[Any]:
    """The values of a picture or .npy file, whose first bytes say which it is."""
    expected = "expected a depth map as PNG, TIFF or .npy"
    try:
        with open_regular(path) as file:
            is_array = file.read(len(_NPY)) == _NPY
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
    image = decode_image(data, cv2.IMREAD_UNCHANGED, str(path))
    if image is None and path.suffix.lower() == ".npy":
        raise _not_an_array(path)
    if image is None:
        raise InputFileError(f"{path}: not a readable image, expected a depth PNG or TIFF")
    _check_memory(path, image.size, image.nbytes)
    return image


def _read_array(path: Path, file: BinaryIO) -> NDArray[Any]:
    """The values of a .npy file, whose header is compared with what follows it."""
    try:
        version = np.lib.format.read_magic(file)
        read_header = _NPY_HEADERS[version]
        shape, is_fortran, dtype = read_header(file)
        there = os.fstat(file.fileno()).st_size - file.tell()
    except Exception as error:  # numpy parses the header as Python: many kinds of errors
        raise _not_an_array(path) from error
    count = math.prod(shape)
    if dtype.hasobject or min(shape, default=0) < 0 or count * dtype.itemsize > there:
        raise _not_an_array(path)
    largest = current_limits().image_pixels
    if count > largest:
        raise InputFileError(
            f"{path}: {count} values, expected at most {largest}, the limit image_pixels"
        )
    _check_memory(path, count, count * dtype.itemsize)
    values = np.fromfile(file, dtype, count)
    values = values.reshape(shape, order="F" if is_fortran else "C")
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
