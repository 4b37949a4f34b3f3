"""Stores of parts: a folder, or a place in an object store that `fsspec` opens by its URL."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Protocol

from basetree.files import writing
from basetree.files.regular import read_regular
from basetree.jobs.errors import FULL, StoreError, full_store

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/+(?=[^/])")


class Store(Protocol):
    """Named files that appear whole, and that all workers see.

    Names are relative, with folders separated by "/". All methods raise `StoreError` if the store
    cannot be read or written.
    """

    @property
    def where(self) -> str:
        """Folder or URL."""

    def write(self, name: str, data: bytes) -> None:
        """Write or replace a file; a reader sees the old content or the new."""

    def read(self, name: str) -> bytes:
        """Return the content of a file."""

    def remove(self, name: str) -> None:
        """Remove a file, if it exists."""

    def sizes(self, folder: str) -> dict[str, int]:
        """Names of the files directly in a folder, with their bytes; none without the folder.

        The folder "" is the store itself.
        """


def is_url(where: str | PurePath) -> bool:
    """Whether a place is given by a URL such as s3://bucket/folder."""
    return _URL.match(str(where)) is not None


def open_store(where: str | PurePath) -> Store:
    """Open the store at a folder or URL. Nothing is created before the first file is written.

    Raises:
        StoreError: If it cannot be opened.
        MissingPackage: If the package for the URL is not installed.
    """
    if not is_url(where):
        return LocalStore(Path(where))
    from basetree.jobs.object_store import ObjectStore

    # A Path reduces the two slashes of a URL to one.
    return ObjectStore(re.sub(r"^([^:]+):/+", r"\1://", str(where)).rstrip("/"))


def fetch(store: Store, names: Iterable[str], folder: Path) -> list[Path]:
    """Copy files of a store into a folder of this machine.

    Returns:
        The copies, under the same names.
    """
    into = LocalStore(folder)
    paths = []
    for name in names:
        into.write(name, store.read(name))
        paths.append(folder / name)
    return paths


def copy_folder(folder: Path, store: Store) -> None:
    """Copy all files of a folder of this machine into a store, under the same names."""
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            store.write(path.relative_to(folder).as_posix(), path.read_bytes())


@dataclass(frozen=True)
class LocalStore:
    """A folder, on a disk of this machine or a disk that machines share."""

    folder: Path

    @property
    def where(self) -> str:
        """The folder."""
        return str(self.folder)

    def write(self, name: str, data: bytes) -> None:
        """Write a file at once or not at all."""
        path = self.folder / name
        with _named(path, "written"):
            path.parent.mkdir(parents=True, exist_ok=True)
            with writing.replacing(path) as stream:
                stream.write(data)

    def read(self, name: str) -> bytes:
        """Return the content of a file."""
        with _named(self.folder / name, "read"):
            return read_regular(self.folder / name)

    def remove(self, name: str) -> None:
        """Remove a file, if it exists."""
        with _named(self.folder / name, "removed"):
            (self.folder / name).unlink(missing_ok=True)

    def sizes(self, folder: str) -> dict[str, int]:
        """Names of the files directly in a folder, with their bytes."""
        inside = self.folder / folder
        with _named(inside, "read"):
            if not inside.is_dir():
                return {}
            return {
                f"{folder}/{path.name}".lstrip("/"): path.stat().st_size
                for path in inside.iterdir()
                if path.is_file() and not path.name.startswith(".")
            }


@contextmanager
def _named(path: Path, done: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            raise full_store(str(path)) from error
        raise StoreError(f"{path}: cannot be {done} ({error.strerror})") from error
