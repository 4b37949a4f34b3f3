"""The root of the project's errors; each package adds the leaves that it raises.

    EdgetreeError              exit code 1
    ├── CheckFailed            exit code 1: the result did not pass a check
    │   └── CheckUndecided     exit code 3: too little is known to pass or fail it
    ├── InputError             exit code 2: a file, folder or value given by the user cannot be used
    │   ├── InputFileError     exit code 2: a file is missing, unreadable or not writable
    │   ├── SettingsError      exit code 2: a setting is out of its range
    │   ├── Unavailable        exit code 1: a camera, port or host that may be there another time
    │   ├── CameraError, DepthError, CloudError (calib)
    │   ├── JobError, StoreError               (basetree.jobs)
    │   ├── DatasetError, CheckpointError      (perceptree)
    │   └── ModelFileError, ServiceError, SignatureError (edgetree)
    └── MissingPackage         exit code 2: an optional package is not installed

Every message is one line that names the file or value, what was found and what was expected. The
command line prints it unchanged.
"""

from __future__ import annotations

from typing import ClassVar

from basetree.secrets import hide_secrets

__all__ = [
    "CheckFailed",
    "CheckUndecided",
    "EdgetreeError",
    "InputError",
    "InputFileError",
    "MissingPackage",
    "SettingsError",
    "Unavailable",
    "install_hint",
    "one_line",
    "short_line",
]

_LONGEST_MESSAGE = 2000
_END_OF_MESSAGE = 500


class EdgetreeError(Exception):
    """Base class of the project's errors; the message is one line meant for the user.

    Messages may quote a file. Line breaks and control characters become spaces, passwords and
    tokens are hidden, and a message of more than 2000 characters is shortened in its middle.
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(short_line(message))


class CheckFailed(EdgetreeError):
    """The result did not pass a check, such as the parity check of an export."""


class CheckUndecided(CheckFailed):
    """The result neither passed nor failed a check, as too little is known."""

    exit_code = 3


class InputError(EdgetreeError):
    """A file, folder, array or value given by the user cannot be used."""

    exit_code = 2


class InputFileError(InputError):
    """A file is missing, unreadable, unsupported, or cannot be written."""


class SettingsError(InputError):
    """A setting is out of its range, or does not fit the others."""


class Unavailable(InputError):
    """Something outside is not there now and may be there when the program is started again."""

    exit_code = 1


class MissingPackage(EdgetreeError):
    """An optional package is needed but not installed."""

    exit_code = 2


def install_hint(*extras: str) -> str:
    """The pip command that installs these extras of the project, for error messages.

    Examples:
        >>> print(install_hint("cpu", "train"))
        pip install ".[cpu,train]" in the project's folder
    """
    return f"""pip install ".[{",".join(extras)}]" in the project's folder"""


def one_line(text: str) -> str:
    r"""Return a text on one line that does nothing to a terminal.

    Line breaks, control characters, and marks that turn the direction of writing become spaces.
    Bytes of file names that are not UTF-8 are kept; streams print them as `\udcff`.

    Examples:
        >>> one_line("a line\nand another")
        'a line and another'
    """
    return text if text.isprintable() else "".join(map(_shown, text))


def short_line(text: str) -> str:
    """Return `one_line` of a text without secrets, at most 2000 characters long."""
    text = hide_secrets(text)
    if len(text) > _LONGEST_MESSAGE:
        start = text[: _LONGEST_MESSAGE - _END_OF_MESSAGE - len(" ... ")]
        text = f"{start} ... {text[-_END_OF_MESSAGE:]}"
    return one_line(text)


def _shown(character: str) -> str:
    is_name_byte = "\udc80" <= character <= "\udcff"
    return character if character.isprintable() or is_name_byte else " "
