"""The highest version of each model that was used here, so that older ones can be refused.

It also keeps the latest time of the clock: a clock that is set back makes no expired signature
valid again.
"""

from __future__ import annotations

import logging
import os
import sys
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

from basetree.errors import InputFileError
from basetree.files.json import json_text
from basetree.files.locking import locked
from basetree.files.writing import write_whole
from edgetree.errors import SignatureError
from edgetree.signing.json_files import read_record
from edgetree.signing.statement import Statement, parse_time, time_text

_log = logging.getLogger(__name__)

_SCHEMA: Final = "edgetree.used-versions/1"
_FILE_NAME: Final = "edgetree-used-versions.json"
_EXPECTED: Final = "a file written by edgetree, or none"
_TIME_STEP: Final = timedelta(days=1)


@dataclass(frozen=True)
class UsedVersion:
    """The highest version of a model that was used.

    Attributes:
        name: The model's name in its signature.
        version: Its version.
        file_sha256: SHA-256 of the file.
    """

    name: str
    version: int
    file_sha256: str


@dataclass(frozen=True)
class UsedVersions:
    """What was used on this machine by this account.

    Attributes:
        latest_time: The latest time at which a model was opened, by the clock; None at first.
        models: The highest version of each model.

    Raises:
        SignatureError: The time is none.
    """

    latest_time: str | None
    models: tuple[UsedVersion, ...]

    def __post_init__(self) -> None:
        if self.latest_time is not None:
            parse_time(self.latest_time)

    def highest(self, name: str) -> UsedVersion | None:
        """The highest version of a model; None if it was never used."""
        return next((model for model in self.models if model.name == name), None)

    def latest(self, now: datetime) -> datetime:
        """The later of `now` and the latest time of the clock."""
        return now if self.latest_time is None else max(now, parse_time(self.latest_time))


def used_file() -> Path:
    """The file of the used versions: in systemd's state folder of a service, or the account's.

    Raises:
        SignatureError: The account has no home folder.
    """
    service = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if service:
        return Path(service, _FILE_NAME)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or os.path.expanduser(r"~\AppData\Local")
    else:
        base = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    if base.startswith("~"):
        raise SignatureError(
            "this account has no home folder for the versions of signed models: expected one, or"
            " StateDirectory= in the service's unit"
        )
    return Path(base, "edgetree", _FILE_NAME)


def read_used(path: Path) -> UsedVersions:
    """Read the used versions; there are none if the file does not exist.

    Raises:
        SignatureError: The file cannot be read, or is not one of edgetree.
    """
    found = read_record(UsedVersions, path, _EXPECTED, _SCHEMA, str(path))
    return found or UsedVersions(None, ())


def check_version(statement: Statement, path: Path, used: UsedVersions, file: Path) -> None:
    """Check that a model is not older than the one that was used here.

    Args:
        statement: The statement of the model's signature.
        path: The model file, for messages.
        used: The used versions.
        file: The file that they were read from, for messages.

    Raises:
        SignatureError: It is older, or has the version of another file.
    """
    highest = used.highest(statement.name)
    if highest is None or statement.version > highest.version:
        return
    what = f"model {path} is version {statement.version} of {statement.name!r}"
    if statement.version < highest.version:
        raise SignatureError(
            f"{what}, and version {highest.version} was used here before (see {file}): expected"
            " that version or a higher one; an older file can be signed again with a higher version"
        )
    if statement.file_sha256 != highest.file_sha256:
        raise SignatureError(
            f"{what}, and another file of that version was used here before (see {file}): expected"
            " a higher version"
        )


def record_use(statement: Statement, path: Path, file: Path, now: datetime) -> None:
    """Check once more that a model is not older than what was used here, and record its use.

    Another process may have used a higher version since the signature was checked. Nothing is
    written for a known version on the same day.

    Args:
        statement: The statement of the model's signature.
        path: The model file, for messages.
        file: The file of the used versions.
        now: The time by the clock.

    Raises:
        SignatureError: The model is older than one that was used, or a new version cannot be
            recorded. A later time that cannot be recorded is a warning, so that a full disk does
            not stop a machine.
    """
    used = read_used(file)
    check_version(statement, path, used, file)
    highest = used.highest(statement.name)
    is_new = highest is None or statement.version > highest.version
    known = None if used.latest_time is None else parse_time(used.latest_time)
    if not is_new and known is not None and used.latest(now) - known < _TIME_STEP:
        return
    try:
        _change(file, now, statement, path)
    except (InputFileError, OSError) as error:
        reason = f"{error.strerror}" if isinstance(error, OSError) else str(error)
        problem = f"the version of model {statement.name!r} cannot be recorded in {file} ({reason})"
        if is_new:
            raise SignatureError(
                f"{problem}: expected a writable folder, such as that of StateDirectory= in a"
                " systemd unit, or XDG_STATE_HOME"
            ) from error
        _log.warning("%s", problem)


def record_time(file: Path, now: datetime) -> None:
    """Record that the clock has shown a time, so that it cannot be set back behind it.

    Failing to write is a warning.

    Args:
        file: The file of the used versions.
        now: The time by the clock.

    Raises:
        SignatureError: The file is not one of edgetree.
    """
    try:
        _change(file, now)
    except (InputFileError, OSError) as error:
        _log.warning("the time cannot be recorded in %s (%s)", file, error)


def _change(
    file: Path, now: datetime, statement: Statement | None = None, path: Path | None = None
) -> None:
    """Write the latest time, and the version of a model that is used, without losing others'."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with locked(file):
        used = read_used(file)
        models = used.models
        if statement is not None and path is not None:
            check_version(statement, path, used, file)
            entry = UsedVersion(statement.name, statement.version, statement.file_sha256)
            models = (*(model for model in models if model.name != statement.name), entry)
        latest = time_text(used.latest(now))
        write_whole(file, json_text(_SCHEMA, asdict(UsedVersions(latest, models))).encode())
