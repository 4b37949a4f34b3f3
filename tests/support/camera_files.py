"""Files of cameras, written and read."""

from __future__ import annotations

from pathlib import Path

import pytest

from basetree.errors import InputFileError
from calib import CameraError, PinholeCamera, load_camera


def write(folder: Path, name: str, text: str) -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.write_text(text)
    return path


def assert_recognised(
    folder: Path, file: str, text: str, name: str | None, expected: PinholeCamera
) -> None:
    """Check that a file gives a camera, by its content alone and with a byte order mark too."""
    assert load_camera(write(folder, file, text), name=name) == expected
    assert load_camera(write(folder, "any.name", f"\ufeff{text}"), name=name) == expected


def assert_refused(folder: Path, text: str, name: str | None, message: str) -> None:
    """Check that a file is refused in one line, which begins with its path."""
    path = write(folder, "camera.any", text)
    with pytest.raises((CameraError, InputFileError)) as caught:
        load_camera(path, name=name)
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
