"""Write files whole: a reader sees the old file or the new one, never half of one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
from numpy.typing import NDArray

from calib.errors import InputFileError


@contextmanager
def replacing(path: Path, beside: Path | None = None) -> Iterator[Path]:
    """Give the block a file to write, which becomes ``path`` when the block ends without an error.

    If the block raises, the file is removed and ``path`` is as it was.

    Args:
        path: the file to write or replace.
        beside: the file that the block writes, in the same folder; ``path`` with ``.part`` at its
            end if not given. Where several processes may write the same ``path`` at once, each
            must give a name of its own.

    Raises:
        OSError: If the file cannot be renamed; and whatever the block raises.
    """
    beside = path.with_name(f"{path.name}.part") if beside is None else beside
    try:
        yield beside
        beside.replace(path)
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file at once or not at all.

    Raises:
        InputFileError: If it cannot be written.
    """
    try:
        with replacing(path) as beside:
            beside.write_bytes(data)
    except OSError as error:
        raise InputFileError(f"{path}: cannot be written ({error.strerror})") from error


def write_text(path: Path, text: str) -> None:
    r"""Write a UTF-8 text file at once or not at all.

    Bytes of file names that are not UTF-8 are spelled out: ``\udcff`` for the byte ff.

    Raises:
        InputFileError: If it cannot be written.
    """
    write_whole(path, text.encode("utf-8", "backslashreplace"))


def write_image(path: Path, image: NDArray[Any], options: Sequence[int] = ()) -> None:
    """Write an image file at once or not at all.

    Args:
        path: File to write; its suffix is the format.
        image: (H, W) or (H, W, 3) BGR.
        options: Flags and values of ``cv2.imwrite``.

    Raises:
        InputFileError: If it cannot be written.
    """
    write_whole(path, cv2.imencode(path.suffix, image, options)[1].tobytes())
