"""The project's own camera files: versioned JSON."""

from __future__ import annotations

import json
from pathlib import Path

from calib.camera import PinholeCamera
from calib.errors import CameraError, InputFileError

SCHEMA = "calib.camera/1"


def load_camera(path: Path | str) -> PinholeCamera:
    """Read a camera; raises InputFileError or CameraError with the file's name."""
    path = Path(path)
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such file, expected a camera as JSON") from error
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise InputFileError(f"{path}: not JSON ({error}), expected a camera") from error
    if not isinstance(values, dict) or values.get("schema") != SCHEMA:
        found = values.get("schema") if isinstance(values, dict) else type(values).__name__
        raise InputFileError(f"{path}: schema is {found!r}, expected {SCHEMA!r}")
    try:
        return PinholeCamera.from_dict(values)
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from error


def save_camera(path: Path | str, camera: PinholeCamera) -> None:
    """Write a camera; raises InputFileError where the file cannot be written."""
    path = Path(path)
    text = json.dumps({"schema": SCHEMA, **camera.to_dict()}, indent=1)
    beside = path.with_name(path.name + ".part")
    try:
        beside.write_text(text + "\n", encoding="utf-8")
        beside.replace(path)
    except OSError as error:
        raise InputFileError(f"{path}: cannot be written ({error.strerror})") from error
