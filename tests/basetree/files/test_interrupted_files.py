"""Ctrl-C at any moment of reading or writing a file stays an interrupt: no error hides it."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from basetree.files.growing import GrowingFile
from basetree.files.locking import locked
from basetree.files.reading import read_picture
from basetree.files.regular import read_regular
from basetree.files.writing import replacing_folder, write_whole


def _grow(path: Path) -> None:
    with GrowingFile(path) as file:
        file.write("a line\n")


def _fill(path: Path) -> None:
    with replacing_folder(path.with_name("folder")) as folder:
        (folder / "file").write_bytes(b"content")


def _lock(path: Path) -> None:
    with locked(path):
        path.read_bytes()


STEPS: dict[str, Callable[[Path], object]] = {
    "read": read_regular,
    "read a picture": read_picture,
    "write": lambda path: write_whole(path, b"content"),
    "grow": _grow,
    "fill a folder": _fill,
    "lock": _lock,
}


class _Interrupt:
    """A profile function that interrupts where Python looks for signals, the n-th time it does."""

    def __init__(self, left: int) -> None:
        self.left = left

    def __call__(self, frame: FrameType, event: str, argument: Any) -> None:
        if event in ("c_return", "call"):
            self.left -= 1
            if self.left == 0:
                sys.setprofile(None)
                raise KeyboardInterrupt


@pytest.mark.parametrize("step", STEPS)
def test_an_interrupt_at_any_moment_is_seen(step: str, tmp_path: Path) -> None:
    moments = 0
    while True:
        path = tmp_path / str(moments) / "file.txt"
        path.parent.mkdir()
        path.write_bytes(b"content")
        interrupt = _Interrupt(moments + 1)
        sys.setprofile(interrupt)
        try:
            STEPS[step](path)
        except KeyboardInterrupt:
            moments += 1
        else:
            break
        finally:
            sys.setprofile(None)
    assert interrupt.left > 0, "an interrupt was lost"
    assert moments > 5
