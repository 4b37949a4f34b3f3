"""Check torch's files before their content is read."""

from __future__ import annotations

import zipfile
from pathlib import Path

_SLACK_BYTES = 2**20


def check_archive(path: Path) -> None:
    """Check that a zip file, torch's format since 1.6, does not unpack to more than it holds.

    torch stores its data uncompressed. Other files are accepted unseen.

    Raises:
        ValueError: If it would unpack to more, or is a damaged zip file.
    """
    if not zipfile.is_zipfile(path):
        return
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise ValueError(f"a damaged zip file: {error}") from error
    size = path.stat().st_size
    if unpacked > size + _SLACK_BYTES:
        raise ValueError(f"{unpacked} bytes unpacked, and only {size} in the file")
