"""Read text, image and video files.

The only place that gives paths to OpenCV: it crashes on names that are not UTF-8.
"""

from __future__ import annotations

import codecs
import hashlib
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputFileError
from basetree.files.limits import current_limits
from basetree.files.names import is_utf8
from basetree.files.picture_size import check_picture_size

_MARKS = (  # that of UTF-32 begins with that of UTF-16
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_CONTROLS = re.compile(rb"[\x00-\x08\x0b\x0e-\x1f\x7f]")


def read_text(path: Path, expected: str) -> str:
    """Read a small text file; `decode_text` says of which encodings.

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
        text = decode_text(data)
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path}: not a text file, expected {expected}") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def decode_text(data: bytes) -> str:
    """Decode a text: UTF-8, UTF-16 or UTF-32 with a byte order mark, or Windows-1252.

    The last is taken where the text is not UTF-8 and has no control characters. ASCII is the same
    in all encodings of eight bits, so that numbers and names are right although a comment in
    another of them is not.

    Raises:
        UnicodeDecodeError: If the data is none of these.
    """
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return data.decode(encoding)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        if _CONTROLS.search(data):
            raise
        return data.decode("cp1252", errors="replace")


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
    return cv2.VideoCapture(str(path))
