"""Check where output files go before the work for them begins."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from pathlib import Path

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


def _check_parent(path: Path) -> None:
    try:
        with errors_naming(path):
            os.stat(os.path.join(path.parent, ""))
    except UnwritableFile as error:
        if error.errno in (errno.ENOENT, errno.ENOTDIR):
            raise
