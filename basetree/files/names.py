"""File names: the suffixes of formats that are read, and names that are not UTF-8.

On Linux a name is a sequence of bytes. Python keeps bytes that are not UTF-8 as surrogates
(`PEP 383 <https://peps.python.org/pep-0383/>`_), which files and most libraries cannot take:
OpenCV crashes on them.
"""

from __future__ import annotations

import os
from pathlib import Path, PureWindowsPath
from typing import Final

IMAGE_SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
HEIF_SUFFIXES: Final = (".heic", ".heif", ".hif")
DEPTH_SUFFIXES: Final = (".png", ".tif", ".tiff", ".npy")
VIDEO_SUFFIXES: Final = (
    *(".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv"),
    *(".ts", ".mts", ".m2ts", ".3gp", ".3g2", ".m2v", ".ogv", ".flv", ".asf", ".vob", ".mxf"),
    *(".h264", ".264", ".h265", ".265", ".hevc", ".mjpg", ".mjpeg", ".ivf", ".y4m", ".dv", ".qt"),
)


def is_utf8(path: Path | str) -> bool:
    """Whether a path is valid UTF-8, so that it can be given to OpenCV and onnxruntime."""
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def printable(text: str) -> str:
    r"""Spell out bytes that are not UTF-8, as `\udcff` for the byte ff; other text is kept."""
    return text.encode("utf-8", "backslashreplace").decode()


def is_inside(name: str) -> bool:
    """Whether a path that a file names stays inside the folder that it is relative to."""
    path = PureWindowsPath(name)  # takes both slashes and drives, on every system
    return bool(path.parts) and not path.anchor and ".." not in path.parts and "\0" not in name
