"""Sizes of pictures, told by their headers before memory for the pixels is taken."""

from __future__ import annotations

from pathlib import Path

from basetree.errors import InputFileError
from basetree.files.headers.formats import picture_header
from basetree.files.headers.header import NotOffered, PictureHeader
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


def file_picture_size(path: Path | str) -> tuple[int, int] | None:
    """Return width and height in px of a picture file, as `picture_size`; None if it has none."""
    try:
        return picture_size(read_regular(Path(path), most_picture_bytes()))
    except OSError:
        return None


def has_deep_grey(path: Path | str) -> bool:
    """Whether a picture file has one channel of more than 8 bits, as depth images have."""
    try:
        header = picture_header(read_regular(Path(path), most_picture_bytes()))
    except (OSError, NotOffered):
        return False
    return header is not None and header.channels == 1 and header.sample_bytes > 1


def checked_header(data: bytes, name: str) -> PictureHeader | None:
    """Read the header of a picture and compare its size with the limit.

    Args:
        data: The whole content of a picture file.
        name: Of the picture, for messages.

    Returns:
        The header; None if the content is no picture or is cut off.

    Raises:
        InputFileError: If it has more pixels than `Limits.image_pixels`, or is of a format that
            is not read.
    """
    try:
        header = picture_header(data)
    except NotOffered as error:
        raise InputFileError(f"{name}: {error}") from error
    if header is None:
        return None
    largest = current_limits().image_pixels
    if header.width * header.height > largest:
        raise InputFileError(
            f"{name}: {header.width}x{header.height} px, expected at most {largest} pixels, the"
            " limit image_pixels"
        )
    return header if header.is_whole else None


def check_memory(header: PictureHeader, name: str, channels: int, sample_bytes: int) -> None:
    """Compare the memory that reading a picture takes with the limit.

    Args:
        header: Its header.
        name: Its name, for messages.
        channels: Channels of the decoded pixels.
        sample_bytes: Bytes of a decoded value.

    Raises:
        InputFileError: If it is more than 5 bytes for each pixel of `Limits.image_pixels`.
    """
    taken, most = header.reading_bytes(channels, sample_bytes), most_picture_bytes()
    if taken > most:
        raise InputFileError(
            f"{name}: {header.width}x{header.height} px of {header.format_name} take"
            f" {taken / 1e6:.3g} MB to read, expected at most {most / 1e6:.3g} MB, {_BYTES_PER_PX}"
            " bytes for each pixel of the limit image_pixels"
        )


def most_picture_bytes() -> int:
    """Return the most bytes that a picture file, and reading it, may take."""
    return _BYTES_PER_PX * current_limits().image_pixels
