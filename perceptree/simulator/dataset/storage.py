"""Files of a dataset: whole or not there, and one clear line where the disk refuses."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.writing import replacing
from perceptree.errors import DatasetError

FRAME_FOLDERS = ("images", "depth", "depth8", "depth_exact")
IMU_FOLDER = "imu"
SCENE_FOLDER = "scenes"
SETTINGS_FILE = "settings.json"

_PART = ".part"
_PNG_LEVEL = 4
_FLAT_PNG_LEVEL = 6
_OUT_OF_SPACE = (errno.ENOSPC, errno.EDQUOT)


def write_atomically(path: Path, data: bytes) -> None:
    """Write beside ``path`` and rename: the file is there whole or not at all.

    Raises OSError with the file's name.
    """
    try:
        with replacing(path, path.with_name(f"{path.name}.{os.getpid()}{_PART}")) as beside:
            beside.write_bytes(data)
    except OSError as error:
        raise OSError(error.errno, os.strerror(error.errno or errno.EIO), str(path)) from error


def remove_leftovers(directory: Path) -> None:
    """Remove what a killed run left half-written."""
    for folder in (
        directory,
        *(directory / name for name in (*FRAME_FOLDERS, SCENE_FOLDER, IMU_FOLDER)),
    ):
        for leftover in sorted(folder.glob(f"*{_PART}")):
            leftover.unlink(missing_ok=True)


def storage_error(error: OSError, directory: Path) -> DatasetError:
    """The user's line for a file that the disk does not take."""
    place = error.filename or directory
    if error.errno in _OUT_OF_SPACE:
        return DatasetError(
            f"{place}: no space left on the disk; what is finished is kept: make room and type the"
            " same command to go on"
        )
    return DatasetError(
        f"{place}: cannot be written ({error.strerror}); type the same command to go on"
    )


def encode_jpeg(image: NDArray[np.uint8], quality: int) -> bytes:
    """(H, W, 3) BGR as JPEG."""
    return _encode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])


def encode_png(image: NDArray[np.uint8] | NDArray[np.uint16], flat: bool = False) -> bytes:
    """(H, W) or (H, W, 3) BGR as PNG; ``flat`` images, equal in patches, pack best raw."""
    chosen = cv2.IMWRITE_PNG_FILTER_NONE if flat else cv2.IMWRITE_PNG_FILTER_SUB
    level = _FLAT_PNG_LEVEL if flat else _PNG_LEVEL
    return _encode(
        ".png", image, [cv2.IMWRITE_PNG_FILTER, chosen, cv2.IMWRITE_PNG_COMPRESSION, level]
    )


def _encode(extension: str, image: Any, options: list[int]) -> bytes:
    return bytes(cv2.imencode(extension, image, options)[1])


def to_millimetres(depth_m: NDArray[np.floating[Any]], limit_m: float) -> NDArray[np.uint16]:
    """(H, W) metres to whole millimetres; 0 where there is nothing or it is beyond ``limit_m``."""
    valid = np.isfinite(depth_m) & (depth_m > 0) & (depth_m <= limit_m)
    return np.asarray(np.rint(np.where(valid, depth_m, 0) * 1000), np.uint16)
