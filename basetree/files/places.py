"""Check where output files go before the work for them begins."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from basetree.errors import InputError
from basetree.files.names import DEPTH_SUFFIXES, IMAGE_SUFFIXES
from basetree.files.writing import NOT_REGULAR, UnwritableFile, errors_naming


def check_folders(files: Iterable[Path | None], folders: Iterable[Path | None] = ()) -> None:
    """Check that the folders of outputs are there, and that no file would replace a folder.

    Other faults of disks, which may pass, show when an output is written.

    Args:
        files: The files; None for outputs that are not given.
        folders: Outputs that are folders themselves.

    Raises:
        UnwritableFile: The folder of an output does not exist or is a file, or a file is a folder.
    """
    files = list(files)
    for path in [*files, *folders]:
        if path is not None:
            _check_parent(path)
    for path in files:
        if path is not None and path.is_dir():
            with errors_naming(path):
                raise OSError(errno.EISDIR, NOT_REGULAR)


def check_paths(outputs: Mapping[str, Path | None], inputs: Mapping[str, Path | None]) -> None:
    """Check that no output overwrites an input or another output.

    Args:
        outputs: The output paths by option; None for options that are not given.
        inputs: The input paths, likewise. A folder includes the images and depth images in it.

    Raises:
        InputError: If an output path occurs twice.
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


def _check_parent(path: Path) -> None:
    try:
        with errors_naming(path):
            os.stat(os.path.join(path.parent, ""))
    except UnwritableFile as error:
        if error.errno in (errno.ENOENT, errno.ENOTDIR):
            raise
