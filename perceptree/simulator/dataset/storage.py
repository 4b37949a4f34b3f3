"""Write a dataset's files atomically, encode images, and report disk errors."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, UInt8
from basetree.files import writing
from perceptree.errors import DatasetError

FRAME_FOLDERS = ("images", "depth", "depth8", "depth_exact")
IMU_FOLDER = "imu"
SCENE_FOLDER = "scenes"
SETTINGS_FILE = "settings.json"

_PNG_LEVEL = 4
_FLAT_PNG_LEVEL = 6
_OUT_OF_SPACE = (errno.ENOSPC, errno.EDQUOT)


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file atomically: to a temporary file that is then renamed.

    Raises:
        OSError: If the file cannot be written; it has the name of the file.
    """
    with writing.replacing(path) as file:
        file.write(data)


def remove_leftovers(directory: Path) -> None:
    """Remove the temporary files of a killed run."""
    for name in (".", *FRAME_FOLDERS, SCENE_FOLDER, IMU_FOLDER):
        writing.remove_leftovers(directory / name)


def storage_error(error: OSError, directory: Path) -> DatasetError:
    """Make the error for a file that cannot be written, with a hint on how to continue."""
    path = error.filename or directory
    if error.errno in _OUT_OF_SPACE:
        return DatasetError(
            f"{path}: no space left on the disk; finished scenes are kept: free some space and run"
            " the same command again to resume"
        )
    return DatasetError(
        f"{path}: cannot be written ({error.strerror}); run the same command again to resume"
    )


def encode_jpeg(image: UInt8, quality: int) -> bytes:
    """Encode an image (H, W, 3) BGR as JPEG."""
    return _encode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])


def encode_png(image: UInt8 | NDArray[np.uint16], flat: bool = False) -> bytes:
    """Encode an image as PNG.

    Args:
        image: (H, W), or (H, W, 3) BGR.
        flat: Whether the image has large areas of equal values, which compress best without a
            PNG filter.
    """
    chosen = cv2.IMWRITE_PNG_FILTER_NONE if flat else cv2.IMWRITE_PNG_FILTER_SUB
    level = _FLAT_PNG_LEVEL if flat else _PNG_LEVEL
    return _encode(
        ".png", image, [cv2.IMWRITE_PNG_FILTER, chosen, cv2.IMWRITE_PNG_COMPRESSION, level]
    )


def _encode(extension: str, image: Any, options: list[int]) -> bytes:
    return bytes(cv2.imencode(extension, image, options)[1])


def to_millimetres(depth_m: Float, limit_m: float) -> NDArray[np.uint16]:
    """Convert depth from metres to whole millimetres.

    Args:
        depth_m: (H, W) depth, m.
        limit_m: Maximum depth, m.

    Returns:
        (H, W) uint16, mm; 0 without a reading or beyond the limit.
    """
    valid = np.isfinite(depth_m) & (depth_m > 0) & (depth_m <= limit_m)
    return np.asarray(np.rint(np.where(valid, depth_m, 0) * 1000), np.uint16)
