"""Errors of calib.

CalibError
├── CameraError        invalid camera, or a camera that does not match the image
├── DepthError         depth map or encoding of the wrong shape, dtype or unit
└── InputFileError     missing, unreadable or unsupported file
"""

from __future__ import annotations

_LONGEST_MESSAGE = 2000
_END_OF_MESSAGE = 500


class CalibError(Exception):
    """Base class of calib's errors; the message is one line meant for the user.

    Messages may quote a file. Line breaks and control characters become spaces, and a message of
    more than 2000 characters is shortened in its middle.
    """

    exit_code = 2

    def __init__(self, message: str = "") -> None:
        super().__init__(short_line(message))


class CameraError(CalibError):
    """Invalid camera, or a camera that does not match the image."""


class DepthError(CalibError):
    """Depth map or encoding of the wrong shape, dtype or unit."""


class InputFileError(CalibError):
    """Missing, unreadable or unsupported file."""


def short_line(text: str) -> str:
    r"""Return a text on one line of at most 2000 characters that a terminal can show.

    Bytes of file names that are not UTF-8 are kept; streams print them as `\udcff`.
    """
    if len(text) > _LONGEST_MESSAGE:
        start = text[: _LONGEST_MESSAGE - _END_OF_MESSAGE - len(" ... ")]
        text = f"{start} ... {text[-_END_OF_MESSAGE:]}"
    return text if text.isprintable() else "".join(map(_shown, text))


def _shown(character: str) -> str:
    is_name_byte = "\udc80" <= character <= "\udcff"
    return character if character.isprintable() or is_name_byte else " "
