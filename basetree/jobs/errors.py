"""Errors of work on several machines."""

from __future__ import annotations

import errno
from typing import Final

from basetree.errors import InputError

FULL: Final = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of a disk without space."""


class JobError(InputError):
    """Shards, parts or workers that do not fit the job."""


class StoreError(InputError):
    """A store that cannot be read or written."""


def full_store(where: str) -> StoreError:
    """The error of a store without space."""
    return StoreError(
        f"{where}: no space left in the store; finished parts are kept: free some space and run the"
        " same command again to go on"
    )


def install_hint(what: str, package: str) -> str:
    """What to install for an option or a URL, as one line."""
    return f'{what} needs the package {package}: install it with pip install ".[fleet]"'
