"""The files of a capture, in its zip file or in the folder that the file was unpacked to."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import BinaryIO, Final

from basetree.errors import InputError
from basetree.files.names import is_inside
from basetree.files.regular import open_regular, read_regular

_MOST_MEMBERS: Final = 1_000_000
_BROKEN: Final = (
    *(zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError),
    *(ValueError, OverflowError),
)


class Members:
    """Files by their names inside of a zip file or folder.

    Args:
        path: A zip file or a folder.

    Attributes:
        names: The names, with slashes.

    Raises:
        InputError: It is neither, or is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._archive: zipfile.ZipFile | None = None
        self._file: BinaryIO | None = None
        if path.is_dir():
            files = (file for file in path.rglob("*") if file.is_file())
            self.names = frozenset(file.relative_to(path).as_posix() for file in files)
            return
        try:
            self._file = open_regular(path)
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror}): expected a zip") from error
        try:
            self._archive = zipfile.ZipFile(self._file)
            entries = self._archive.infolist()
        except (*_BROKEN, OSError) as error:
            self.close()
            raise InputError(f"{path} is no whole zip file ({error}): expected one") from error
        if len(entries) > _MOST_MEMBERS:
            self.close()
            raise InputError(f"{path} has {len(entries)} files: expected at most {_MOST_MEMBERS}")
        self.names = frozenset(entry.filename for entry in entries if is_inside(entry.filename))

    def read(self, name: str, largest_bytes: int) -> bytes:
        """Read a file.

        Raises:
            InputError: It is missing, damaged or larger.
        """
        where = f"{name} of {self.path}"
        if name not in self.names:
            raise InputError(f"{where} does not exist: expected it")
        try:
            if self._archive is None:
                return read_regular(self.path / name, largest_bytes)
            with self._archive.open(name) as stream:
                data = stream.read(largest_bytes + 1)
        except OSError as error:
            raise InputError(f"{where} cannot be read ({error.strerror or error})") from error
        except _BROKEN as error:
            raise InputError(f"{where} cannot be read ({error})") from error
        if len(data) > largest_bytes:
            raise InputError(f"{where} is larger than {largest_bytes} bytes: expected less")
        return data

    def close(self) -> None:
        """Close the zip file; nothing can be read afterwards."""
        if self._file is not None:
            self._file.close()
