"""Only regular files are opened: pipes, devices and folders are named, and nothing waits."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from basetree.errors import InputError
from basetree.files.reading import is_image_file, open_video, read_image, read_text
from basetree.files.regular import open_regular, read_regular
from calib import load_camera, read_depth
from edgetree.frames.images import read_image as read_colour
from edgetree.frames.images import read_masks

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes")


def _pipe(folder: Path) -> Path:
    os.mkfifo(folder / "pipe.png")
    return folder / "pipe.png"


def _socket(folder: Path) -> Path:
    path = folder / "socket.png"
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(os.path.relpath(path))
    return path


def _folder(folder: Path) -> Path:
    (folder / "folder.png").mkdir()
    return folder / "folder.png"


def _linked(folder: Path) -> Path:
    (folder / "link.png").symlink_to("/dev/zero")
    return folder / "link.png"


KINDS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "pipe": (_pipe, "a named pipe, expected a regular file"),
    "socket": (_socket, "a socket, expected a regular file"),
    "folder": (_folder, "a folder, expected a regular file"),
    "device": (lambda _: Path("/dev/zero"), "a device, expected a regular file"),
    "link to a device": (_linked, "a device, expected a regular file"),
}
READERS: dict[str, Callable[[Path], object]] = {
    "depth": read_depth,
    "image": read_colour,
    "mask": lambda path: read_masks(path, (4, 3)),
    "camera": load_camera,
    "text": lambda path: read_text(path, "a text"),
    "video": open_video,
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_not_a_regular_file_is_named(kind: str, tmp_path: Path) -> None:
    make, expected = KINDS[kind]
    path = make(tmp_path)
    with pytest.raises(OSError, match=expected):
        open_regular(path)
    assert read_image(path) is None
    assert not is_image_file(path)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("kind", ["pipe", "link to a device"])
def test_readers_do_not_wait_for_pipes_or_devices(kind: str, reader: str, tmp_path: Path) -> None:
    make, expected = KINDS[kind]
    with pytest.raises(InputError, match=expected):
        READERS[reader](make(tmp_path))


def test_a_regular_file_is_read_up_to_a_limit(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"0123456789")
    assert read_regular(path) == read_regular(path, 10) == b"0123456789"
    with pytest.raises(OSError, match="larger than 9 bytes"):
        read_regular(path, 9)
    (tmp_path / "link").symlink_to(path)
    assert read_regular(tmp_path / "link") == b"0123456789"
    with pytest.raises(OSError, match="not a path"):
        open_regular("a\0b")


def test_a_file_of_holes_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "depth.png"
    path.write_bytes(cv2.imencode(".png", np.ones((3, 4), np.uint16))[1].tobytes())
    os.truncate(path, 2**40)
    for read in (read_depth, read_colour):
        with pytest.raises(InputError, match="larger than 1000000000 bytes"):
            read(path)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="made of no file's bytes")
def test_files_without_a_stated_size_are_read_whole() -> None:
    assert b"VmPeak" in read_regular("/proc/self/status", 2**20)
