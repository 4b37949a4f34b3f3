"""Errors of calib.

CalibError
├── CameraError        a camera that cannot be, or does not fit the image
├── DepthError         a depth map or encoding of the wrong shape, type or unit
└── InputFileError     a file that is missing, unreadable or of another kind
"""

from __future__ import annotations


class CalibError(Exception):
    """Anything that calib refuses; its text is one line for the user."""

    exit_code = 2


class CameraError(CalibError):
    """A camera that cannot be, or that does not fit the image."""


class DepthError(CalibError):
    """A depth map or encoding of the wrong shape, type or unit."""


class InputFileError(CalibError):
    """A file that is missing, unreadable or of another kind."""
