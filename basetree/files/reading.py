"""Read text, image and video files.

The only place that gives paths to OpenCV: it crashes on names that are not UTF-8.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputFileError
from basetree.files.limits import current_limits
from basetree.files.names import is_utf8
from basetree.files.picture_size import check_picture_size


def read_text(path: Path, expected: str) -> str:
    """Read a small UTF-8 text file.

    Args:
        path: The file.
        expected: What the file should be, for messages.

    Raises:
        InputFileError: If the file is missing, unreadable, not text or too large.
    """
    largest = current_limits().text_file_bytes
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such file, expected {expected}") from error
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:  # a NUL in the path
        raise InputFileError(f"{path}: not a path ({error}), expected {expected}") from error
    if len(data) > largest:
        raise InputFileError(
            f"{path}: larger than {largest} bytes, the limit text_file_bytes, expected {expected}"
        )
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path}: not a text file, expected {expected}") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's content, as 64 hexadecimal digits.

    Raises:
        OSError: If it cannot be read.
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_image(path: Path, flags: int = cv2.IMREAD_COLOR) -> NDArray[Any] | None:
    """Read an image file as `cv2.imread` does, with any name.

    Args:
        path: File to read.
        flags: Flags of `cv2.imread`.

    Returns:
        (H, W) or (H, W, channels); None if the file cannot be read or is not an image.

    Raises:
        InputFileError: If it has more pixels than `Limits.image_pixels`.
    """
    check_picture_size(path)
    try:
        data = path.read_bytes()
    except OSError:
        return None
    return decode_image(data, flags)


def decode_image(
    data: bytes | NDArray[np.uint8], flags: int = cv2.IMREAD_COLOR
) -> NDArray[Any] | None:
    """Decode the content of an image file.

    Args:
        data: The content.
        flags: Flags of `cv2.imread`.

    Returns:
        (H, W) or (H, W, channels); None if it is not an image.
    """
    content = np.frombuffer(data, np.uint8)
    try:
        return cv2.imdecode(content, flags) if content.size else None
    except cv2.error:
        return None


def is_image_file(path: Path) -> bool:
    """Whether OpenCV knows the format of a file; False for names that are not UTF-8."""
    return is_utf8(path) and bool(cv2.haveImageReader(str(path)))


def open_video(path: Path) -> cv2.VideoCapture:
    """Open a video file; `isOpened` of the result tells whether OpenCV can read it.

    Raises:
        InputFileError: If the name is not UTF-8.
    """
    if not is_utf8(path):
        raise InputFileError(
            f"{path}: its name is not UTF-8, with which OpenCV cannot open videos: expected"
            " another name"
        )
    # FFmpeg takes the beginning of a relative name such as 10:30.mp4 for a protocol, and OpenCV's
    # reader of picture series takes digits and % for a pattern.
    has_ffmpeg = cv2.videoio_registry.hasBackend(cv2.CAP_FFMPEG)
    return cv2.VideoCapture(os.path.abspath(path), cv2.CAP_FFMPEG if has_ffmpeg else cv2.CAP_ANY)
