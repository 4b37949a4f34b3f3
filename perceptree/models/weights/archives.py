"""Check torch's files before their content is read."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path

_SLACK_BYTES = 2**20
_CHUNK_BYTES = 2**20


def check_archive(path: Path) -> None:
    """Check the size and the checksums of a zip file, torch's format since 1.6.

    torch stores its data uncompressed, so a file must not unpack to more than it holds. torch
    itself does not compare the checksums. Other files are accepted unseen.

    Raises:
        ValueError: If it would unpack to more, or is a damaged zip file.
    """
    if not zipfile.is_zipfile(path):
        return
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
            size = path.stat().st_size
            if unpacked <= size + _SLACK_BYTES:
                _check_sums(archive)
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError) as error:
        raise ValueError(f"a damaged zip file: {error}") from error
    if unpacked > size + _SLACK_BYTES:
        raise ValueError(f"{unpacked} bytes unpacked, and only {size} in the file")


def _check_sums(archive: zipfile.ZipFile) -> None:
    """Compare each entry with its CRC-32, which zipfile does when an entry is read to its end.

    torch can save without checksums, and then writes 0.
    """
    for entry in archive.infolist():
        if entry.CRC:
            with archive.open(entry) as stream:
                while stream.read(_CHUNK_BYTES):
                    pass
