"""Write files atomically: a reader sees the old or the new file, never a part."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from calib.errors import InputFileError


def write_whole(path: Path, data: bytes) -> None:
    """Write to a file beside ``path``, then rename it.

    Raises:
        InputFileError: If the file cannot be written.
    """
    beside = path.with_name(path.name + ".part")
    try:
        beside.write_bytes(data)
        beside.replace(path)
    except OSError as error:
        raise InputFileError(f"{path}: cannot be written ({error.strerror})") from error
    finally:
        with suppress(OSError):
            beside.unlink()
