"""Sizes of pictures, told by their headers before memory for the pixels is taken."""

from __future__ import annotations

from pathlib import Path

import cv2

from basetree.errors import InputFileError
from basetree.files.headers import NotOffered, PictureHeader, picture_header
from basetree.files.limits import current_limits
from basetree.files.regular import read_regular

_BYTES_PER_PX = 5  # of memory, for each pixel of the limit


def check_picture_size(path: Path | str) -> None:
    """Check that a picture has no more pixels than `Limits.image_pixels`.

    Files that are no pictures and unreadable ones are accepted, for the reader to refuse.

    Raises:
        InputFileError: If it has more, or is of a format that is not read.
    """
    try:
        data = read_regular(Path(path), most_picture_bytes())
    except OSError:
        return
    checked_header(data, str(path))


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height in px that a picture states, as stored.

    Args:
        data: The whole content of a picture file.

    Returns:
        (width, height); None if the content is no picture, is cut off, or is of a format that is
        not read.
    """
    try:
        header = picture_header(data)
    except NotOffered:
        return None
    return (header.width, header.height) if header and header.is_whole else None


def checked_header(
    data: bytes, name: str, flags: int = cv2.IMREAD_GRAYSCALE
) -> PictureHeader | None:
    """Read the header of a picture and compare it with the limits.

    Args:
        data: The whole content of a picture file.
        name: Of the picture, for messages.
        flags: Flags of `cv2.imread` with which it is to be decoded.

    Returns:
        The header; None if the content is no picture or is cut off.

    Raises:
        InputFileError: If it has more pixels than `Limits.image_pixels`, or reading it would take
            more than 5 bytes of memory for each of them, or it is of a format that is not read.
    """
    try:
        header = picture_header(data)
    except NotOffered as error:
        raise InputFileError(f"{name}: {error}") from error
    if header is None:
        return None
    largest, most_bytes = current_limits().image_pixels, most_picture_bytes()
    size = f"{name}: {header.width}x{header.height} px"
    if header.width * header.height > largest:
        raise InputFileError(f"{size}, expected at most {largest} pixels, the limit image_pixels")
    is_unchanged = flags == cv2.IMREAD_UNCHANGED
    grey_or_colour = 3 if flags & (cv2.IMREAD_COLOR | cv2.IMREAD_ANYCOLOR) else 1
    channels = header.channels if is_unchanged else grey_or_colour
    keeps_depth = is_unchanged or bool(flags & cv2.IMREAD_ANYDEPTH)
    reading_bytes = header.reading_bytes(channels, header.sample_bytes if keeps_depth else 1)
    if reading_bytes > most_bytes:
        raise InputFileError(
            f"{size} of {header.format_name} take {reading_bytes / 1e6:.3g} MB to read, expected at"
            f" most {most_bytes / 1e6:.3g} MB, {_BYTES_PER_PX} bytes for each pixel of the limit"
            " image_pixels"
        )
    return header if header.is_whole else None


def most_picture_bytes() -> int:
    """Return the most bytes that a picture file, and reading it, may take."""
    return _BYTES_PER_PX * current_limits().image_pixels
