"""Writing so that nobody ever finds half a file: beside first, renamed when whole."""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from calib import writing
from edgetree.errors import InputError

__all__ = ["check_paths", "output_folder", "replacing", "text_file"]


def check_paths(outputs: Mapping[str, Path | None], inputs: Mapping[str, Path | None]) -> None:
    """Refuse to write one path twice, or over what is read, before any work is done.

    Args:
        outputs: what will be written, by its option; None where it was not asked for.
        inputs: what will be read, likewise; a folder stands for its images and depth images too.

    Raises:
        InputError: a path is among them twice.
    """
    taken: dict[Path, str] = {}
    for name, path in inputs.items():
        if path is not None:
            taken[path.resolve()] = f"{name} {path}"
            taken.update(dict.fromkeys(_frames_in(path), f"a file of {name} {path}"))
    for option, path in outputs.items():
        if path is None:
            continue
        other = taken.setdefault(path.resolve(), f"{option} {path}")
        if other != f"{option} {path}":
            raise InputError(f"{option} is {path}, which is {other} too: expected another path")


def _frames_in(folder: Path) -> list[Path]:
    from edgetree.frames.sources import DEPTH_SUFFIXES, IMAGE_SUFFIXES

    if not folder.is_dir():
        return []
    known = {*IMAGE_SUFFIXES, *DEPTH_SUFFIXES}
    return [path.resolve() for path in folder.iterdir() if path.suffix.lower() in known]


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give the name of a file beside `path` to write; it becomes `path` if the block ends well.

    That it can be written is proven before the block, and until the block writes it there is no
    such file. If the block raises, it is removed and `path` is as it was.

    Raises:
        InputError: the file cannot be made there.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected the name of a file to write")
    unique = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    with writing.replacing(path, unique) as temporary:
        try:
            temporary.touch(exist_ok=False)
            temporary.unlink()
        except OSError as error:
            raise InputError(
                f"{path} cannot be written ({error.strerror}):"
                " expected a file in a folder that is there and can be written"
            ) from error
        yield temporary


@contextmanager
def text_file(path: Path) -> Iterator[TextIO]:
    """A file that appears when all of its lines are in it; they end as they are written."""
    with (
        replacing(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as stream,
    ):
        yield stream


@contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """Make the folder if needed and prove that it can be written, before any work is done.

    Folders made here are removed again if the block raises and left them empty.

    Raises:
        InputError: it cannot be made or written.
    """
    made = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        _remove_empty(made)
        raise InputError(
            f"output folder {path} cannot be written ({error.strerror}):"
            " expected a folder that is there, or can be made, and can be written"
        ) from error
    try:
        yield path
    except BaseException:
        _remove_empty(made)
        raise


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()
