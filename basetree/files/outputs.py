"""Atomic writing: a file is written under a temporary name and renamed when it is complete."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TextIO

from basetree.errors import InputError
from basetree.files import writing
from basetree.files.names import DEPTH_SUFFIXES, IMAGE_SUFFIXES


def check_paths(outputs: Mapping[str, Path | None], inputs: Mapping[str, Path | None]) -> None:
    """Check that no output overwrites an input or another output.

    Args:
        outputs: the output paths by option; None for options that are not given.
        inputs: the input paths, likewise. A folder includes the images and depth images in it.

    Raises:
        InputError: an output path occurs twice.
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
    if not folder.is_dir():
        return []
    known = {*IMAGE_SUFFIXES, *DEPTH_SUFFIXES}
    return [path.resolve() for path in folder.iterdir() if path.suffix.lower() in known]


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Yield a file to write, which replaces `path` if the block succeeds.

    It is created before the block. If the block raises, `path` is left unchanged.

    Raises:
        InputError: the file cannot be created or written.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected the name of a file to write")
    try:
        with writing.replacing(path) as stream:
            yield stream
    except OSError as error:
        if error.filename != str(path):
            raise
        raise InputError(
            f"{path} cannot be written ({error.strerror}):"
            " expected a file in an existing, writable folder with space for it"
        ) from error


@contextmanager
def text_file(path: Path) -> Iterator[TextIO]:
    r"""Open a UTF-8 text file as in `replacing`. Line ends are not translated.

    Bytes of file names that are not UTF-8 are spelled out: `\udcff` for the byte ff.
    """
    with replacing(path) as stream:
        text = io.TextIOWrapper(stream, "utf-8", "backslashreplace", newline="")
        try:
            yield text
            text.flush()
        finally:
            with suppress(OSError, InputError):
                text.detach()  # or it would close the file


@contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """Create a folder if needed and check that it is writable.

    If the block raises, the folders created here are removed again, unless they contain files.

    Raises:
        InputError: the folder cannot be created or is not writable.
    """
    made = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        _remove_empty(made)
        raise InputError(
            f"output folder {path} cannot be written ({error.strerror}):"
            " expected a writable folder, or one that can be created"
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
