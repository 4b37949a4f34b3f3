"""Read text, image and video files.

The only place that gives paths to OpenCV: it crashes on names that are not UTF-8.
"""

from __future__ import annotations

import codecs
import errno
import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputFileError
from basetree.files.headers import heif
from basetree.files.headers.exif import UPRIGHT, orientation_words, turned_upright
from basetree.files.headers.formats import has_known_signature, picture_header
from basetree.files.headers.header import DepthNote, NotOffered, PictureHeader
from basetree.files.headers.tiff import as_stored
from basetree.files.limits import current_limits
from basetree.files.names import is_utf8
from basetree.files.picture_size import check_memory, checked_header, most_picture_bytes
from basetree.files.regular import open_regular, read_regular

_SIGNATURE_BYTES = 16

_MARKS = (  # that of UTF-32 begins with that of UTF-16
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_CONTROLS = re.compile(rb"[\x00-\x08\x0b\x0e-\x1f\x7f]")


def read_text(path: Path, expected: str, largest_bytes: int | None = None) -> str:
    """Read a small text file; `decode_text` says of which encodings.

    Args:
        path: The file.
        expected: What the file should be, for messages.
        largest_bytes: Size of the largest file; `Limits.text_file_bytes` if None.

    Raises:
        InputFileError: If the file is missing, unreadable, not text or too large.
    """
    largest = largest_bytes or current_limits().text_file_bytes
    try:
        data = read_regular(path, largest)
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such file, expected {expected}") from error
    except OSError as error:
        too_large = error.errno == errno.EFBIG and largest_bytes is None
        limit = ", the limit text_file_bytes" if too_large else ""
        raise InputFileError(
            f"{path}: cannot be read ({error.strerror}{limit}), expected {expected}"
        ) from error
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
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture as its file stores it.

    Attributes:
        pixels: (H, W) or (H, W, channels) as stored: the pixels of the camera.
        orientation: EXIF orientation, 1 to 8, as the file states it; 1 if it states none.
        format_name: Such as "JPEG", as the content says it.
        focal_px: Focal length in px that EXIF metadata state; None if they state none.
        depth: What the depth image in the file is, which is not read here; None without one.
    """

    pixels: NDArray[Any]
    orientation: int = 1
    format_name: str = ""
    focal_px: float | None = None
    depth: DepthNote | None = None

    def upright(self) -> NDArray[Any]:
        """The pixels turned as the orientation says, as viewers of pictures show them."""
        if self.orientation == UPRIGHT:
            return self.pixels
        return turned_upright(self.pixels, self.orientation)


def read_picture(path: Path, flags: int = cv2.IMREAD_COLOR) -> Picture | None:
    """Read an image file, with any name.

    Args:
        path: File to read.
        flags: Flags of `cv2.imread`.

    Returns:
        The stored pixels and the orientation; None if the file cannot be read, is cut off or is
        not an image.

    Raises:
        InputFileError: If it has more pixels than `Limits.image_pixels`, or would take more memory
            than 5 bytes for each of them, or is of a format that is not read.
    """
    try:
        data = read_regular(path, most_picture_bytes())
    except OSError:
        return None
    return decode_picture(data, flags, str(path))


def decode_picture(
    data: bytes | NDArray[np.uint8], flags: int = cv2.IMREAD_COLOR, name: str = "the picture"
) -> Picture | None:
    """Decode the content of an image file.

    Args:
        data: The content.
        flags: Flags of `cv2.imread`.
        name: Of the picture, for messages.

    Returns:
        As for `read_picture`.

    Raises:
        InputFileError: As for `read_picture`.
    """
    content = data if isinstance(data, bytes) else data.tobytes()
    header = checked_header(content, name)
    if header is None:
        return None
    check_memory(header, name, *_decoded_kind(header, flags))
    if header.format_name == heif.FORMAT_NAME:
        decoded = heif.decode(content)
        return None if decoded is None else _picture(decoded, header)
    if flags != cv2.IMREAD_UNCHANGED:
        flags |= cv2.IMREAD_IGNORE_ORIENTATION
    if header.format_name.startswith("TIFF") and header.orientation != UPRIGHT:
        content = as_stored(content)
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error:
        return None
    return None if pixels is None else _picture(pixels, header)


def _picture(pixels: NDArray[Any], header: PictureHeader) -> Picture:
    return Picture(pixels, header.orientation, header.format_name, header.focal_px, header.depth)


def _decoded_kind(header: PictureHeader, flags: int) -> tuple[int, int]:
    """Channels and bytes of a value that a picture has when it is decoded with these flags."""
    if flags == cv2.IMREAD_UNCHANGED:
        return header.channels, header.sample_bytes
    channels = 3 if flags & (cv2.IMREAD_COLOR | cv2.IMREAD_ANYCOLOR) else 1
    return channels, header.sample_bytes if flags & cv2.IMREAD_ANYDEPTH else 1


def read_image(path: Path, flags: int = cv2.IMREAD_COLOR) -> NDArray[Any] | None:
    """Read the stored pixels of an image file; as `read_picture`, without the orientation."""
    picture = read_picture(path, flags)
    return None if picture is None else picture.pixels


def decode_image(
    data: bytes | NDArray[np.uint8], flags: int = cv2.IMREAD_COLOR, name: str = "the picture"
) -> NDArray[Any] | None:
    """Decode the stored pixels of an image file's content; as `decode_picture`."""
    picture = decode_picture(data, flags, name)
    return None if picture is None else picture.pixels


def orientation_note(path: Path) -> str:
    """Say, for a message about a picture's size, that its orientation was not applied.

    Returns:
        Words that follow a size; empty if the picture states no orientation.
    """
    try:
        header = picture_header(read_regular(path, most_picture_bytes()))
    except (OSError, NotOffered):
        return ""
    if header is None or header.orientation == UPRIGHT:
        return ""
    return f" as stored ({orientation_words(header.orientation)})"


def is_image_file(path: Path) -> bool:
    """Whether a file begins like a picture."""
    try:
        with open_regular(path) as file:
            return has_known_signature(file.read(_SIGNATURE_BYTES))
    except OSError:
        return False


def open_video(path: Path, *, upright: bool = True) -> cv2.VideoCapture:
    """Open a video file; `isOpened` of the result tells whether OpenCV can read it.

    Args:
        path: The file.
        upright: Whether the frames are turned as the file says; otherwise they are as stored.

    Raises:
        InputFileError: If the name is not UTF-8, or it is not a regular file.
    """
    if not is_utf8(path):
        raise InputFileError(
            f"{path}: its name is not UTF-8, with which OpenCV cannot open videos: expected"
            " another name"
        )
    try:
        open_regular(path).close()
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror})") from error
    # FFmpeg takes the beginning of a relative name such as 10:30.mp4 for a protocol, and OpenCV's
    # reader of picture series takes digits and % for a pattern.
    has_ffmpeg = cv2.videoio_registry.hasBackend(cv2.CAP_FFMPEG)
    backend = cv2.CAP_FFMPEG if has_ffmpeg else cv2.CAP_ANY
    capture = cv2.VideoCapture(os.path.abspath(path), backend)
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, float(upright))
    return capture
