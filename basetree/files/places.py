"""Check where output files go before the work for them begins."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from basetree.files.writing import errors_naming


def check_folders(files: Iterable[Path | None]) -> None:
    """Check that the folders of output files are there.

    Args:
        files: The files; None for outputs that are not given.

    Raises:
        UnwritableFile: The folder of a file does not exist, or is a file itself.
    """
    for path in files:
        if path is not None:
            with errors_naming(path):
                os.stat(os.path.join(path.parent, ""))
