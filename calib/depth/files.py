"""Read and write depth maps: 16-bit images with a scale, or floats in metres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, Float32
from basetree.errors import InputFileError
from basetree.files.limits import current_limits
from basetree.files.reading import read_image
from basetree.files.writing import write_image
from calib.depth.convention import check_scale, values_to_metres

_MM_PER_M = 1000.0
_MAX_MM = 65535


def read_depth(path: Path | str, scale: float | None = None) -> Float32:
    """Read a depth map.

    Args:
        path: Single-channel PNG, TIFF or .npy file of integers or floating point.
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
    if not path.is_file():
        raise InputFileError(f"{path}: no such file, expected a depth map as PNG, TIFF or .npy")
    values = _read_array(path) if path.suffix.lower() == ".npy" else _read_image(path)
    return values_to_metres(values, scale, str(path))


def in_millimetres(depth_m: Float) -> NDArray[np.uint16]:
    """Convert metres to whole millimetres; 0 for readings that are no number of 16 bits."""
    steps = np.where(np.isfinite(depth_m), np.rint(depth_m * _MM_PER_M), 0)
    return np.where((steps < 0) | (steps > _MAX_MM), 0, steps).astype(np.uint16)


def _read_array(path: Path) -> NDArray[Any]:
    largest = current_limits().image_pixels
    try:
        # Mapped: numpy takes no memory for a size that the header states and the file has not.
        values = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # numpy parses the header as Python: many kinds of errors
        raise InputFileError(
            f"{path}: not a readable .npy file, expected one (H, W) array of depth"
        ) from error
    if not isinstance(values, np.ndarray):
        raise InputFileError(f"{path}: several arrays, expected one (H, W) array of depth")
    if values.size > largest:
        raise InputFileError(
            f"{path}: {values.size} values, expected at most {largest}, the limit image_pixels"
        )
    return np.array(values, values.dtype.newbyteorder("="))


def _read_image(path: Path) -> NDArray[Any]:
    image = read_image(path, cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputFileError(f"{path}: not a readable image, expected a depth PNG or TIFF")
    return image


def write_depth(path: Path | str, depth_m: Float) -> None:
    """Write (H, W) metres as a 16-bit PNG in millimetres.

    Readings that are not finite, negative or beyond 65.535 m are written as 0, no reading. The file
    is replaced atomically.

    Raises:
        InputFileError: If the file cannot be written.
    """
    write_image(Path(path), in_millimetres(depth_m))
