"""Errors of fleet.

FleetError
├── JobError         shards, parts or workers that do not fit the job
├── StoreError       a store that cannot be read or written
└── MissingEngine    an optional package is not installed
"""

from __future__ import annotations

from calib.errors import short_line


class FleetError(Exception):
    """Base class of fleet's errors; the message is one line meant for the user."""

    exit_code = 2

    def __init__(self, message: str = "") -> None:
        super().__init__(short_line(message))


class JobError(FleetError):
    """Shards, parts or workers that do not fit the job."""


class StoreError(FleetError):
    """A store that cannot be read or written."""


class MissingEngine(FleetError):
    """An optional package is needed but not installed."""


def full_store(where: str) -> StoreError:
    """The error of a store without space."""
    return StoreError(
        f"{where}: no space left in the store; finished parts are kept: free some space and run the"
        " same command again to go on"
    )


def install_hint(what: str, package: str) -> str:
    """What to install for an option or a URL, as one line."""
    return f'{what} needs the package {package}: install it with pip install ".[fleet]"'
